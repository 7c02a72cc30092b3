"""A ground station by MAVSDK: prints, as JSON lines, the named values that it receives."""

import json
import sys
import time

from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.mavlink_direct import MavlinkDirect

station = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
station.add_any_connection(sys.argv[1])
vehicle = station.first_autopilot(120.0)
direct = MavlinkDirect(vehicle)


def tell(message, _):
    said = {"from": [message.system_id, message.component_id], **json.loads(message.fields_json)}
    print(json.dumps(said), flush=True)


direct.subscribe_message("NAMED_VALUE_FLOAT", tell)
time.sleep(float(sys.argv[2]))
station.destroy()
