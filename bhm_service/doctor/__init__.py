"""What is wrong with a machine, a link or an autopilot's settings, and how to mend it."""
