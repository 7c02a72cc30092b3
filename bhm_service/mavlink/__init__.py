"""MAVLink and the logs that hold it: the only room that knows pymavlink, pyserial, sentinels and frames."""
