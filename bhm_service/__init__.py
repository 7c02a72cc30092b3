"""Remaining flying time of a multirotor's battery: onboard beside the autopilot, and from recordings."""
