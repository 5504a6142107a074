"""Sending one command to the swarm from the operator's shell."""

from __future__ import annotations

import random
import time

from flightstack.swarm import topics
from flightstack.swarm.admission import Admission, Message, Refusal
from flightstack.swarm.wire import CommandName, CommandOutcome, DroneState, GroundReport
from gcs.commands.survey_command import SurveyCommand
from gcs.connection import Connection

POLL_S = 0.05


def command_swarm(
    connection: Connection,
    name: CommandName,
    target: int,
    deadline_s: float,
    *,
    without_recording: bool = False,
) -> SurveyCommand:
    """Publish the command until everybody has answered or `deadline_s` of real time has passed."""
    node = connection.node("command")
    admission = Admission()  # whoever answers is listed, also a drone of another frame
    transport = connection.open(node)
    try:
        command = SurveyCommand(
            name,
            sender=node,
            target=target,
            members=connection.members,
            started_s=time.monotonic(),
            deadline_s=deadline_s,
            without_recording=without_recording,
            incarnation=random.SystemRandom().randrange(1, 1 << 31),  # its name is another one each time
        )
        while not command.done(time.monotonic()):
            if command.due(time.monotonic()):
                transport.publish(topics.COMMAND, topics.COMMAND.codec.encode(command.command))
            time.sleep(POLL_S)
            for received in transport.receive():
                if received.topic not in (topics.STATE, topics.OUTCOME, topics.REPORT):
                    continue
                message = admission.admit(received)
                # A drone of another version cannot answer us either, and is shown as not heard.
                if not isinstance(message, Refusal):
                    _take(command, message)
    finally:
        transport.close()
    return command


def _take(command: SurveyCommand, message: Message) -> None:
    match message:
        case DroneState():
            command.heard(message.sender)
        case CommandOutcome():
            command.answered(message)
        case GroundReport():
            for vehicle in message.vehicles:
                command.heard(vehicle.drone)
