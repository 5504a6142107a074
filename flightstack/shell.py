"""The open ends of one agent: its autopilot's link, its instruments' ports and the network.

One thread drains them all and never waits; what cannot be sent now is dropped and counted by the end that could not
send it.
"""

from __future__ import annotations

import dataclasses
import pathlib

from flightstack.agent import Inputs, Outputs, PeerMessage
from flightstack.config import DroneConfig
from flightstack.mavlink.link import ByteLink, LinkError, open_link
from flightstack.mavlink.link.signed_link import SignedLink
from flightstack.mavlink.signing_store import SigningKeyError, SigningStore
from flightstack.recording.clock import Clock
from flightstack.sensing.filter_stage import PortInput
from flightstack.swarm.topics import RECEIVED_BY_DRONES, TOPICS
from flightstack.transport import Transport, TransportError
from flightstack.transport.endpoints import faulty_field
from flightstack.transport.shared_radio import behind_radio
from flightstack.transport.zenoh_transport import ZenohTransport
from mission.documents.yaml_file import fault_of
from sensors.instruments.registry import instrument_type
from sensors.serial.port import InstrumentPort


@dataclasses.dataclass
class Shell:
    link: ByteLink
    ports: dict[str, InstrumentPort]
    transport: Transport

    def gather(self, late_ticks: int) -> Inputs:
        ports: list[PortInput] = []
        for name, port in self.ports.items():
            data, events = port.read(), port.events()
            ports += [PortInput(name, connected=True) for event in events if event.connected]
            if data:
                ports.append(PortInput(name, data))
            ports += [PortInput(name, lost=event.reason) for event in events if not event.connected]
        peers = tuple(PeerMessage(r.topic.name, r.sender, r.payload) for r in self.transport.receive())
        return Inputs(self.link.read(), tuple(ports), peers, late_ticks)

    def send(self, outputs: Outputs) -> None:
        if outputs.autopilot:
            self.link.write(outputs.autopilot)
        for name, data in outputs.ports:
            self.ports[name].write(data)
        for topic, payload in outputs.peers:
            self.transport.publish(TOPICS[topic], payload)

    def close(self) -> None:
        for port in self.ports.values():
            port.close()
        self.transport.close()
        self.link.close()


def _open_autopilot(config: DroneConfig, file: str) -> ByteLink:
    key = config.autopilot.signing_key
    try:
        store = None if key is None else SigningStore(pathlib.Path(key))
    except SigningKeyError as error:
        raise fault_of(file, "autopilot.signing_key", str(error)) from error
    try:
        link = open_link(config.autopilot.link)
    except LinkError as error:
        raise fault_of(file, "autopilot.link", str(error)) from error
    return link if store is None else SignedLink(link, store, 0)


def open_shell(config: DroneConfig, clock: Clock, file: str = "configuration") -> Shell:
    """Open everything that the configuration names. What cannot be opened raises with one clear line."""
    link = _open_autopilot(config, file)
    try:
        transport = ZenohTransport(
            config.swarm.name,
            config.drone,
            listen=config.swarm.listen,
            connect=config.swarm.connect,
            receives=RECEIVED_BY_DRONES,
            tls=config.swarm.tls,
            members=config.swarm.members,
            site=config.swarm.site,
        )
        heard = behind_radio(transport, config.drone, config.radio, clock.now_s)
    except TransportError as error:
        link.close()
        raise fault_of(file, faulty_field(error), str(error)) from error
    except BaseException:
        link.close()
        raise
    ports = {
        item.name: InstrumentPort(
            item.port, item.baud or instrument_type(item.type).baud or 9600, clock.now_s
        )
        for item in config.instruments
        if item.port != "mavlink"
    }
    return Shell(link, ports, heard)
