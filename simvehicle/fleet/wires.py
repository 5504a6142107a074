"""The sockets at the ends of a drone's wires."""

from __future__ import annotations

from flightstack.mavlink.link import ByteLink, LinkError, open_link
from simvehicle.drone.drones import Drone, DroneBytes
from simvehicle.fleet.fleet_problems import FleetError

_DATAGRAM_BYTES = 1200


class Wires:
    """One drone's: its MAVLink links and its instruments' lines, which are closed while they are unplugged.

    `FleetError` where one cannot be opened, with nothing left open. `field`: of the drone in its configuration.
    """

    def __init__(self, drone: Drone, field: str) -> None:
        self._drone = drone
        self._field = field
        self.links: list[ByteLink] = []
        self._lines: dict[str, ByteLink] = {}
        try:
            for index, text in enumerate(drone.spec.links):
                self.links.append(_opened(text, f"{field}.links[{index}]"))
            self.plug()
        except FleetError:
            self.close()
            raise

    def plug(self) -> None:
        """Listen for what is plugged, and for nothing else."""
        for index, item in enumerate(self._drone.spec.instruments):
            plugged = self._drone.lines.is_plugged(item.name)
            if plugged and item.name not in self._lines:
                place = f"{self._field}.instruments[{index}].port"
                self._lines[item.name] = _opened(f"tcpin:{item.port}", place)
            elif not plugged and item.name in self._lines:
                self._lines.pop(item.name).close()

    def read(self) -> DroneBytes:
        return DroneBytes(
            tuple((index, data) for index, link in enumerate(self.links) if (data := link.read())),
            tuple((name, data) for name, line in self._lines.items() if (data := line.read())),
        )

    def write(self, said: DroneBytes) -> None:
        waiting: dict[int, bytearray] = {}
        for index, frame in said.links:
            buffer = waiting.setdefault(index, bytearray())
            if len(buffer) + len(frame) > _DATAGRAM_BYTES:  # whole frames: a lost datagram damages no other
                self.links[index].write(bytes(buffer))
                buffer.clear()
            buffer += frame
        for index, buffer in waiting.items():
            self.links[index].write(bytes(buffer))
        for name, data in said.instruments:
            if name in self._lines:
                self._lines[name].write(data)

    def close(self) -> None:
        for link in (*self.links, *self._lines.values()):
            link.close()
        self._lines.clear()


def _opened(text: str, field: str) -> ByteLink:
    try:
        return open_link(text)
    except LinkError as error:
        raise FleetError(field, str(error)) from error
