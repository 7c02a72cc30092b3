"""The apps of the bus: each hears some messages and returns others; none knows a clock, a socket or another app."""
