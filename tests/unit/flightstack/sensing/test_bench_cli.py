"""`flightstack sensors`, command by command, on recordings."""

from __future__ import annotations

import io
import json
import pathlib
from typing import Any

import pytest
from rich.console import Console
from typer.testing import CliRunner

from flightstack.sensing.bench_cli import app
from flightstack.sensing.bench_display import LiveDisplay, bar
from sensors.instruments.registry import INSTRUMENTS
from sensors.instruments.samples import InstrumentState, Quantity, Sample
from sensors.instruments.sensor_error import SensorError
from sensors.serial.captures import sample_line

SBA5 = (
    b"W,34.5\r\nZ,1 of 25\r\nZ,25 of 25\r\n"
    b"M 50885 48094 500.96 55.0 0.0 0.0 829 55.0 55.0 00\r\n"
    b"M 50885 48094 500.96 55.0 0.0 0.0 829 55.0 55.0 03"
)


def run(*arguments: object, code: int = 0) -> str:
    result = CliRunner().invoke(app, [str(a) for a in arguments], catch_exceptions=False)
    assert result.exit_code == code, result.output
    return result.stdout


def lines(text: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in text.splitlines()]


@pytest.fixture
def capture(tmp_path: pathlib.Path) -> pathlib.Path:
    path = tmp_path / "sba5.bin"
    path.write_bytes(SBA5)
    return path


@pytest.fixture
def recording(tmp_path: pathlib.Path) -> pathlib.Path:
    path = tmp_path / "pass.jsonl"
    samples = [
        Sample(
            0.1 * i, "sba5", InstrumentState.MEASURING, co2_ppm=420.0 + (i * 7 % 5) / 2, quantity=Quantity.CO2
        )
        for i in range(80)
    ]
    samples.insert(
        50, Sample(5.0, "sba5", InstrumentState.ZEROING, reason="zeroing 1 of 25", quantity=Quantity.CO2)
    )
    path.write_text("\n".join(map(sample_line, samples)) + "\n")
    return path


def test_list_names_every_type() -> None:
    text = run("list")
    assert all(name in text for name in INSTRUMENTS)
    found = {entry["type"]: entry for entry in lines(run("list", "--json"))}
    assert found["sba5"]["baud"] == 19200
    assert "poll_hz" in found["sba5"]["options"]


def test_decode_gives_one_line_for_every_message(capture: pathlib.Path) -> None:
    found = lines(run("decode", capture, "--type", "sba5", "--json"))
    assert [entry["state"] for entry in found] == ["warming", "zeroing", "zeroing", "measuring", "error"]
    assert [entry.get("co2_ppm") for entry in found] == [None, None, None, 500.96, None]
    assert (found[4]["status"], found[4]["reason"]) == ("03", "too hot")
    assert all({"state", "status", "reason"} <= entry.keys() for entry in found)
    assert "500.96 ppm" in run("decode", capture, "--type", "SBA-5")


@pytest.mark.parametrize(
    ("type_name", "data"), [("sba5", b""), ("mavlink", b"\xfe\x55 no frame"), ("sba5", b"OK\r\n")]
)
def test_decode_says_where_there_is_no_message(tmp_path: pathlib.Path, type_name: str, data: bytes) -> None:
    path = tmp_path / "nothing.bin"
    path.write_bytes(data)
    with pytest.raises(SensorError, match=f"no message of a {type_name} in its {len(data)} bytes"):
        run("decode", path, "--type", type_name, "--json")


def test_decode_takes_options(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "wind.bin"
    path.write_bytes(b"U 00.00 V 05.00 W 00.00\r\n")
    (found,) = lines(run("decode", path, "--type", "trisonica", "--option", "mount_yaw_deg=90", "--json"))
    assert found["wind_body_mps"] == pytest.approx([0.0, 5.0, 0.0], abs=1e-6)
    assert "co2_ppm" not in found


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("decode", "FILE", "--type", "sba6"), "unknown instrument type"),
        (("decode", "no-such-file", "--type", "sba5"), "cannot be read"),
        (("decode", "FILE", "--type", "sba5", "--option", "poll_hz"), "write it as NAME=VALUE"),
        (("decode", "FILE", "--type", "sba5", "--option", "speed=3"), "unknown field"),
        (("tune", "FILE"), "say which with --type"),
        (("tune", "FILE", "--type", "sba5"), "valid CO2 readings are too few"),
        (("tune", "/dev/null", "--type", "sba5"), "it is empty"),
        (("plot", "/dev/null"), "it is empty"),
        (("read", "--port", "socket://nowhere", "--type", "sba5"), "socket://HOST:PORT"),
        (("read", "--port", "/dev/null", "--type", "mavlink"), "no port of its own"),
    ],
)
def test_mistakes_are_one_line(arguments: tuple[str, ...], words: str, capture: pathlib.Path) -> None:
    with pytest.raises(SensorError, match=words) as caught:
        run(*[capture if a == "FILE" else a for a in arguments])
    assert "\n" not in str(caught.value)


def test_tune_prints_noise_and_lag(recording: pathlib.Path) -> None:
    (found,) = lines(run("tune", recording, "--json"))
    assert found["noise_ppm"] > 0.0
    assert found["lag_s"] > 0.0
    assert found["readings"] == 80
    text = run("tune", recording)
    assert "lag_s" in text
    assert "noise_ppm" in text


def test_plot_draws_a_recording(
    recording: pathlib.Path, capture: pathlib.Path, tmp_path: pathlib.Path
) -> None:
    run("plot", recording)
    assert recording.with_suffix(".png").read_bytes().startswith(b"\x89PNG")
    run("plot", capture, "--type", "sba5", "--out", tmp_path / "out.svg")
    assert "<svg" in (tmp_path / "out.svg").read_text()
    with pytest.raises(SensorError, match="cannot be written"):
        run("plot", recording, "--out", tmp_path / "no" / "where.png")


def test_plot_without_matplotlib_says_what_to_install(
    recording: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(SensorError, match=r"pip install flightstack\[sim\]"):
        run("plot", recording)


def test_calibrate_compares_recordings(tmp_path: pathlib.Path) -> None:
    for name, offset_ppm in (("one", 0.0), ("two", 6.0)):
        samples = [
            Sample(
                0.5 * i,
                "co2",
                InstrumentState.MEASURING,
                co2_ppm=420.0 + offset_ppm + i % 3,
                quantity=Quantity.CO2,
            )
            for i in range(120)
        ]
        (tmp_path / f"{name}.jsonl").write_text("\n".join(map(sample_line, samples)))
    kept = tmp_path / "kept.json"
    files = [tmp_path / "one.jsonl", tmp_path / "two.jsonl"]
    found = {entry["drone"]: entry for entry in lines(run("calibrate", *files, "--out", kept, "--json"))}
    assert found["one"]["offset_ppm"] - found["two"]["offset_ppm"] == pytest.approx(6.0)
    assert json.loads(kept.read_text())["two"]["made_at"].endswith("+00:00")


def test_doctor_says_why_nobody_answers(tmp_path: pathlib.Path) -> None:
    text = run("doctor", "--port", tmp_path / "ttyNone", "--type", "sba5", "--seconds", 0.1, code=1)
    assert "no instrument" in text
    assert "no such device" in text


def test_live_display_shows_number_state_bar_and_sparkline() -> None:
    console = Console(file=io.StringIO(), width=90, force_terminal=False)
    display = LiveDisplay(console)
    for second in range(8):
        display.sample(
            Sample(
                2.0 * second,
                "k30",
                InstrumentState.MEASURING,
                co2_ppm=420.0 + 10 * second,
                quantity=Quantity.CO2,
            )
        )
    display.tick()
    with console.capture() as captured:
        console.print(display.render())
    display.close()
    text = captured.get()
    assert "measuring" in text
    assert "490.00 ppm" in text
    assert "▁▂▃▄▅▆▇█" in text
    assert "█" * 60 in text
    assert "in the last 15 s, 8 messages" in text
    assert bar(1.0, 0.0, 4.0, 8) == "██░░░░░░"
