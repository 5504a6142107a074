"""`flightstack sensors`: instruments on the bench and their recordings."""

from __future__ import annotations

import json
import pathlib
import sys
import time
from typing import Annotated, Any

import typer
import yaml

from sensors.captures import decode as decode_stream
from sensors.captures import is_json_lines, read_bytes, read_samples, sample_line, usual_period_s
from sensors.errors import SensorError
from sensors.instruments import INSTRUMENTS, instrument_type, make_instrument
from sensors.samples import InstrumentState, Sample

app = typer.Typer(
    help="Instruments: what there are, what one on a port says, and what a recording holds.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)

TypeOption = Annotated[str, typer.Option("--type", help="Instrument type; `list` names them.")]
JsonOption = Annotated[bool, typer.Option("--json", help="One JSON object a line instead of text.")]
OptionOption = Annotated[
    list[str] | None, typer.Option("--option", help="NAME=VALUE, as under `options` in a drone's file.")
]
FileArgument = Annotated[
    pathlib.Path, typer.Argument(help="JSON lines of `read --json`, or raw bytes with --type.")
]


@app.command("list")
def list_types(as_json: JsonOption = False) -> None:
    """The known instrument types, with their usual baud rates and options."""
    if as_json:
        for entry in INSTRUMENTS.values():
            typer.echo(
                json.dumps(
                    {
                        "type": entry.name,
                        "measures": entry.quantity.value,
                        "baud": entry.baud,
                        "description": entry.description,
                        "options": list(entry.options.__struct_fields__),
                    }
                )
            )
        return
    from rich.console import Console
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for title in ("type", "measures", "baud", "what it is"):
        table.add_column(title, no_wrap=title != "what it is")
    for entry in INSTRUMENTS.values():
        table.add_row(entry.name, entry.quantity.value, str(entry.baud or "-"), entry.description)
    Console().print(table)


@app.command()
def decode(
    file: Annotated[pathlib.Path, typer.Argument(help="Raw bytes as the instrument sent them.")],
    type_name: TypeOption,
    as_json: JsonOption = False,
    option: OptionOption = None,
) -> None:
    """What a recorded byte stream says: one line for every message of the instrument."""
    instrument = make_instrument(type_name, None, _options(option))
    period_s = usual_period_s(instrument_type(type_name))
    for sample in decode_stream(instrument, read_bytes(file), period_s):
        typer.echo(sample_line(sample) if as_json else sample_text(sample))


@app.command()
def read(
    port: Annotated[str, typer.Option(help="/dev/ttyUSB0, socket://HOST:PORT, or what else pyserial opens.")],
    type_name: TypeOption,
    baud: Annotated[int | None, typer.Option(help="Baud rate, if it is not the type's usual one.")] = None,
    seconds: Annotated[
        float | None, typer.Option(help="Stop after this time; without it, at Ctrl-C.")
    ] = None,
    as_json: JsonOption = False,
    option: OptionOption = None,
) -> None:
    """Show what an instrument on a port says, live. Ends with 1 if it never gave a reading."""
    from sensors.attached import AttachedInstrument
    from sensors.port import InstrumentPort

    entry = instrument_type(type_name)
    if entry.baud is None:
        raise SensorError(f"{entry.name} has no port of its own: its readings come through the autopilot")
    began_s = time.monotonic()

    def now_s() -> float:
        return time.monotonic() - began_s

    attached = AttachedInstrument(
        make_instrument(type_name, None, _options(option)), InstrumentPort(port, baud or entry.baud, now_s)
    )
    measured = 0
    last: Sample | None = None
    show = _printer(as_json)
    try:
        while seconds is None or now_s() < seconds:
            samples = attached.step(now_s())
            for sample in samples:
                measured += sample.state is InstrumentState.MEASURING
                last = sample
                show.sample(sample)
            show.tick()
            time.sleep(0.02)
    except KeyboardInterrupt:
        pass
    finally:
        show.close()
        attached.close()
    if not measured:
        reason = last.reason or last.state.value if last is not None else "not a byte came"
        typer.echo(f"flightstack: {port}: no reading from a {entry.name}: {reason}", err=True)
        raise typer.Exit(1)


def sample_text(sample: Sample) -> str:
    """A sample in one line for a person."""
    head = f"{sample.time_s:9.2f} s  {sample.state.value:<9}"
    parts = []
    if sample.co2_ppm is not None:
        parts.append(f"{sample.co2_ppm:9.2f} ppm")
    for vector, frame in (
        (sample.wind_body_mps, "forward, right, down"),
        (sample.wind_ned_mps, "north, east, down"),
    ):
        if vector is not None:
            numbers = ", ".join(f"{v:+.2f}" for v in vector)
            parts.append(f"towards {numbers} m/s ({frame})")
    if sample.status:
        parts.append(f"status {sample.status}")
    if sample.reason:
        parts.append(sample.reason)
    return f"{head}  {'  '.join(parts)}".rstrip()


def _options(given: list[str] | None) -> dict[str, Any]:
    options: dict[str, Any] = {}
    for text in given or []:
        name, equals, value = text.partition("=")
        if not equals or not name:
            raise SensorError(f"--option {text}: write it as NAME=VALUE")
        try:
            options[name] = yaml.safe_load(value)
        except yaml.YAMLError as error:
            raise SensorError(f"--option {text}: the value cannot be read") from error
    return options


def _load(file: pathlib.Path, type_name: str | None, option: list[str] | None) -> list[Sample]:
    """Samples of a recording: JSON lines as they are, raw bytes with the type that made them."""
    data = read_bytes(file)
    if is_json_lines(data):
        return read_samples(file)
    if type_name is None:
        raise SensorError(f"{file}: raw bytes of an instrument: say which with --type")
    instrument = make_instrument(type_name, None, _options(option))
    return list(decode_stream(instrument, data, usual_period_s(instrument_type(type_name))))


class _Lines:
    """Samples as lines, for files, pipes and terminals alike."""

    def __init__(self, as_json: bool) -> None:
        self._as_json = as_json

    def sample(self, sample: Sample) -> None:
        typer.echo(sample_line(sample) if self._as_json else sample_text(sample))
        sys.stdout.flush()

    def tick(self) -> None:
        """Nothing to redraw."""

    def close(self) -> None:
        """Nothing to put back."""


def _printer(as_json: bool) -> Any:
    if as_json or not sys.stdout.isatty():
        return _Lines(as_json)
    from flightstack.sensors_live import LiveDisplay

    return LiveDisplay()
