"""`flightstack sensors`: instruments on the bench and their recordings."""

from __future__ import annotations

import json
import pathlib
import sys
import time
from typing import Annotated, Any

import msgspec
import typer

from mission.documents.printable import printable
from mission.documents.yaml_file import parse_value
from sensors.filters.co2_model import Co2FilterConfig
from sensors.filters.filter_settings import co2_filter_config
from sensors.instruments.registry import INSTRUMENTS, instrument_type, make_instrument
from sensors.instruments.samples import InstrumentState, Quantity, Sample
from sensors.instruments.sensor_error import SensorError
from sensors.serial.captures import decode as decode_stream
from sensors.serial.captures import is_json_lines, read_bytes, read_samples, sample_line, usual_period_s

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
MaybeTypeOption = Annotated[
    str | None, typer.Option("--type", help="What made the raw bytes; `list` names them.")
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
    period_s, data, count = usual_period_s(instrument_type(type_name)), read_bytes(file), 0
    for sample in decode_stream(instrument, data, period_s):
        typer.echo(sample_line(sample) if as_json else sample_text(sample))
        count += 1
    if not count:
        raise SensorError(f"{file}: no message of a {instrument.kind} in its {len(data)} bytes")


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
    from sensors.serial.attached import AttachedInstrument
    from sensors.serial.port import InstrumentPort

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
        text = f"flightstack: {port}: no reading from a {entry.name}: {reason}"
        typer.echo(printable(text), err=True)
        raise typer.Exit(1)


@app.command()
def plot(
    file: FileArgument,
    type_name: MaybeTypeOption = None,
    out: Annotated[
        pathlib.Path | None, typer.Option(help="PNG, SVG or PDF; default: beside the file.")
    ] = None,
    option: OptionOption = None,
) -> None:
    """Draw a recording: readings, the filter's estimate with its 95 % band, states without a value."""
    from sensors.filters.estimate_plots import recording_figure, save

    samples = _load(file, type_name, option)
    target = out or file.with_suffix(".png")
    save(recording_figure(samples, _co2_config(samples, type_name), file.name), target)
    typer.echo(f"{target}: {len(samples)} messages drawn")


@app.command()
def tune(
    file: FileArgument,
    type_name: MaybeTypeOption = None,
    as_json: JsonOption = False,
    option: OptionOption = None,
) -> None:
    """Fit the instrument's noise and lag to a recording by maximum likelihood, and print them."""
    from rich.console import Console
    from rich.progress import Progress

    from sensors.calibration.tuning import Fitted, tune_co2, tune_wind

    samples = _load(file, type_name, option)
    is_co2 = any(s.quantity is Quantity.CO2 or s.co2_ppm is not None for s in samples)
    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("fitting", total=1.0)

        def progress(share: float) -> None:
            bar.update(task, completed=share)

        numbers: dict[str, Fitted]
        if is_co2:
            co2 = tune_co2(samples, _co2_config(samples, type_name) or Co2FilterConfig(), progress)
            numbers, readings, likelihood = (
                {"lag_s": co2.lag_s, "noise_ppm": co2.noise_ppm},
                co2.readings,
                co2.log_likelihood,
            )
        else:
            wind = tune_wind(samples, progress)
            numbers = {name: getattr(wind, name) for name in ("noise_mps", "gust_sd_mps", "gust_time_s")}
            readings, likelihood = wind.readings, wind.log_likelihood
    if as_json:
        result: dict[str, Any] = {name: round(n.value, 4) for name, n in numbers.items()}
        result["factors"] = {name: round(n.factor, 3) for name, n in numbers.items()}
        typer.echo(json.dumps(result | {"readings": readings, "log_likelihood": round(likelihood, 1)}))
        return
    for name, fitted in numbers.items():
        doubt = f"within a factor of {fitted.factor:.2f}" if fitted.known else "not told by this recording"
        typer.echo(f"{name:<12} {fitted.value:8.3f}   {doubt}")
    typer.echo(f"from {readings} readings, log likelihood {likelihood:.1f}")


@app.command()
def calibrate(
    files: Annotated[list[pathlib.Path], typer.Argument(help="One recording (JSON lines) for each drone.")],
    out: Annotated[pathlib.Path | None, typer.Option(help="Write the calibrations here, as JSON.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Cross-calibrate drones that stood side by side: each one's offset and scale against the median."""
    import datetime

    from sensors.calibration.side_by_side import cross_calibrate
    from sensors.calibration.side_by_side import save as save_calibrations

    made_at = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    found = cross_calibrate({f.stem: read_samples(f) for f in files}, made_at)
    for name, calibration in found.items():
        if as_json:
            typer.echo(json.dumps({"drone": name} | msgspec.to_builtins(calibration)))
        else:
            typer.echo(
                f"{name:<16} offset {calibration.offset_ppm:+8.2f} ppm   scale {calibration.scale:.4f}   "
                f"scatter {calibration.scatter_ppm:.2f} ppm over {calibration.seconds} s"
            )
    if out is not None:
        save_calibrations(out, found)


@app.command()
def doctor(
    port: Annotated[
        list[str] | None, typer.Option(help="Look at this port; default: all of this machine.")
    ] = None,
    type_names: Annotated[
        list[str] | None, typer.Option("--type", help="Look for this type only; may be given again.")
    ] = None,
    seconds: Annotated[
        float, typer.Option(help="How long to listen at each rate and to each question.")
    ] = 2.5,
    as_json: JsonOption = False,
) -> None:
    """Find the ports, tell which instrument answers on each, and why the others do not. Ends with 1 if none
    does."""
    from sensors.serial.doctor import diagnose, serial_ports

    types = [instrument_type(t).name for t in type_names] if type_names else None
    ports = port or serial_ports()
    if not ports:
        raise SensorError("this machine has no serial port: plug the instrument in, or name one with --port")
    answered = 0
    for name in ports:
        found = diagnose(name, types, seconds)
        answered += found.type_name is not None
        if as_json:
            typer.echo(
                json.dumps(
                    {"port": name, "type": found.type_name, "baud": found.baud, "detail": found.detail}
                )
            )
        else:
            who = f"{found.type_name} at {found.baud} baud" if found.type_name else "no instrument"
            typer.echo(printable(f"{name}: {who}: {found.detail}"))
    if not answered:
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
        parts.append(printable(sample.reason))
    return f"{head}  {'  '.join(parts)}".rstrip()


def _options(given: list[str] | None) -> dict[str, Any]:
    options: dict[str, Any] = {}
    for text in given or []:
        name, equals, value = text.partition("=")
        if not equals or not name:
            raise SensorError(f"--option {text}: write it as NAME=VALUE")
        options[name] = parse_value(value, f"--option {name}")
    return options


def _load(file: pathlib.Path, type_name: str | None, option: list[str] | None) -> list[Sample]:
    """Samples of a recording: JSON lines as they are, raw bytes with the type that made them."""
    data = read_bytes(file)
    if not data.strip():
        raise SensorError(f"{file}: it is empty: there is no recording in it")
    if is_json_lines(data):
        return read_samples(file)
    if type_name is None:
        raise SensorError(f"{file}: raw bytes of an instrument: say which with --type")
    instrument = make_instrument(type_name, None, _options(option))
    return list(decode_stream(instrument, data, usual_period_s(instrument_type(type_name))))


def _co2_config(samples: list[Sample], type_name: str | None) -> Co2FilterConfig | None:
    """The filter's numbers for what made these samples: the given type, or one whose name the samples
    carry."""
    for name in [type_name] if type_name else sorted({s.instrument for s in samples}):
        try:
            entry = instrument_type(name)
        except SensorError:
            if type_name:
                raise
            continue
        if entry.co2 is not None:
            return co2_filter_config(entry.name)
    return None


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
    from flightstack.sensing.bench_display import LiveDisplay

    return LiveDisplay()
