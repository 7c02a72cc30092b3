"""A multirotor that is not there: it flies on its own physics and speaks real MAVLink.

Nothing here imports the package's battery models or effects: what the service is tested against must not be itself.
"""
