"""An autopilot by MAVSDK's telemetry server: a battery of 15.5 V, no current sensor, twenty metres up."""

import sys
import time

from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.telemetry_server import (
    Battery,
    Heading,
    LandedState,
    Position,
    TelemetryServer,
    VelocityNed,
    VtolState,
)

autopilot = Mavsdk(Configuration.create_with_component_type(ComponentType.AUTOPILOT))
autopilot.add_any_connection(sys.argv[1])
server = TelemetryServer(autopilot.server_component_by_id(1))
until = time.monotonic() + float(sys.argv[2])
while time.monotonic() < until:
    server.publish_battery(Battery(voltage_v=15.5, remaining_percent=80.0))
    server.publish_position(Position(47.0, 8.5, 500.0, 20.0), VelocityNed(1.0, 0.0, 0.0), Heading(90.0))
    server.publish_extended_sys_state(VtolState.MC, LandedState.IN_AIR)
    time.sleep(0.2)
autopilot.destroy()
