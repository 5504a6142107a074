"""Plans written as QGroundControl's .plan files, so that reading them gives the same plan again."""

from __future__ import annotations

from typing import Any

import msgspec

from mission.documents.flight_plan import Plan, PlanItem
from mission.geometry.geofence import Geofence


def plan_text(plan: Plan) -> str:
    """`plan` as a QGroundControl .plan file."""
    fence = plan.geofence or Geofence()
    home = plan.home
    mission: dict[str, Any] = {
        "version": 2,
        "firmwareType": plan.firmware_type if plan.firmware_type is not None else 0,
        "vehicleType": plan.vehicle_type if plan.vehicle_type is not None else 2,
        "globalPlanAltitudeMode": 1,
        "items": [_item_object(item) for item in plan.items],
    }
    if home is not None:
        mission["plannedHomePosition"] = [home.latitude_deg, home.longitude_deg, home.amsl_m]
    if plan.cruise_mps is not None:
        mission["cruiseSpeed"] = plan.cruise_mps
    if plan.hover_mps is not None:
        mission["hoverSpeed"] = plan.hover_mps
    areas = [(vertices, True) for vertices in fence.inclusion]
    areas += [(vertices, False) for vertices in fence.exclusion]
    rounds = [(circle, True) for circle in fence.inclusion_circles]
    rounds += [(circle, False) for circle in fence.exclusion_circles]
    document = {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "QGroundControl",
        "mission": mission,
        "geoFence": {
            "version": 2,
            "polygons": [
                {"version": 1, "inclusion": inclusion, "polygon": vertices} for vertices, inclusion in areas
            ],
            "circles": [
                {
                    "version": 1,
                    "inclusion": inclusion,
                    "circle": {
                        "center": [circle.latitude_deg, circle.longitude_deg],
                        "radius": circle.radius_m,
                    },
                }
                for circle, inclusion in rounds
            ],
        },
        "rallyPoints": {
            "version": 2,
            "points": [[point.latitude_deg, point.longitude_deg, point.amsl_m] for point in plan.rally],
        },
    }
    return msgspec.json.format(msgspec.json.encode(document), indent=4).decode() + "\n"


def _item_object(item: PlanItem) -> dict[str, Any]:
    found: dict[str, Any] = {
        "type": "SimpleItem",
        "command": item.command,
        "frame": item.frame,
        "params": item.params,
        "autoContinue": item.auto_continue,
        "doJumpId": item.jump_id,
    }
    if item.altitude_mode is not None:
        # QGroundControl wants the three together.
        found |= {
            "AltitudeMode": item.altitude_mode,
            "Altitude": item.params[6],
            "AMSLAltAboveTerrain": None,
        }
    return found
