"""Instruments that somebody has set otherwise: read through, switched on connection, or named."""

from __future__ import annotations

import pytest

from sensors.instruments.checksums import xor_checksum
from sensors.instruments.registry import make_instrument
from sensors.instruments.samples import InstrumentState, Sample

MEASURING, WARMING, ZEROING = InstrumentState.MEASURING, InstrumentState.WARMING, InstrumentState.ZEROING
ERROR = InstrumentState.ERROR
WHOLE = "M 50885 48094 500.96 55.0 0.0 0.0 829 55.0 55.0"


def samples(type_name: str, *lines: str, ending: str = "\r\n") -> list[Sample]:
    instrument = make_instrument(type_name, "it")
    data = "".join(line + ending for line in lines).encode("latin-1")
    return instrument.receive(1.0, data) + instrument.ended(1.0)


def one(type_name: str, line: str) -> Sample:
    (found,) = samples(type_name, line)
    return found


def nmea(body: str) -> str:
    return f"${body}*{xor_checksum(body.encode()):02X}"


def gill(body: str) -> str:
    return f"\x02{body}\x03{xor_checksum(body.encode()):02X}"


# --- SBA-5 ---


@pytest.mark.parametrize("ending", [",043C", " 0A3FC", ", 3EC", ",0A3F"])
def test_sba5_check_sums_are_read_over(ending: str) -> None:
    sample = one("sba5", f"{WHOLE} 00{ending}")
    assert (sample.state, sample.co2_ppm, sample.status) == (MEASURING, 500.96, "00")
    assert one("sba5", f"{WHOLE} 03{ending}").reason == "too hot"


def test_sba5_check_sums_end_every_line() -> None:
    found = samples("sba5", "W,23.4,0A3C", "Z,1 of 25,1B2C", "C2,043C", "OK,09AC", "S,16,1,043C")
    assert [s.state for s in found] == [WARMING, ZEROING]


def test_sba5_analog_voltage_before_the_status() -> None:
    sample = one("sba5", f"{WHOLE} 0640 00")
    assert (sample.state, sample.co2_ppm, sample.status) == (MEASURING, 500.96, "00")


def test_sba5_continuous_display_has_words_or_nothing_for_a_status() -> None:
    assert one("sba5", WHOLE).co2_ppm == 500.96
    assert one("sba5", f"{WHOLE} OK").co2_ppm == 500.96
    assert one("sba5", f"{WHOLE} Low CO2").reason == "it says: Low CO2"
    assert one("sba5", WHOLE.replace("50885", "12000")).reason.startswith("low detector counts")
    assert one("sba5", WHOLE.replace("55.0 0.0", "41.0 0.0")).reason == "too cold"


@pytest.mark.parametrize(
    "line",
    [
        "M 50885 48094 500.96 55.0 829 00",  # F212, the manual's example
        "M 500.96 00",  # F4
        "M 50885 48094 500.96 00",
        "M 500.96 55.0 0.0 0.0 829 55.0 55.0 00",
        "M 500.96 829 0640 00",
    ],
)
def test_sba5_fields_that_are_switched_off_are_asked_for_and_read_through_once_it_is_steady(
    line: str,
) -> None:
    instrument = make_instrument("sba5")
    instrument.connected(0.0)
    data = f"{line}\r\n".encode()
    first = instrument.receive(0.1, data)
    assert [s.state for s in first] == [ERROR]
    assert "F252 sends all" in first[0].reason
    assert instrument.poll(0.2)[0] == b"F252\r"
    assert instrument.poll(0.3)[0] == b"M", "once is enough"
    second, third = instrument.receive(0.4, data), instrument.receive(0.5, data)
    assert [s.state for s in (*second, *third)] == [ERROR, MEASURING]
    assert third[0].co2_ppm == 500.96


def test_sba5_a_line_that_lost_fields_is_never_a_reading_of_another_format() -> None:
    lost = "M 50885 48094 500.96 55.0 0.0 829 55.0 55.0 00"
    found = samples("sba5", lost, f"{WHOLE} 00", lost, f"{WHOLE} 00", lost)
    assert [s.state for s in found] == [ERROR, MEASURING, ERROR, MEASURING, ERROR]
    cut = samples("sba5", *["M 50885 48094 50"] * 5)
    assert [s.state for s in cut] == [ERROR] * 5, "no counts are taken for CO2"


# --- LI-850 ---

RAW = "<raw><co2>3051967</co2><co2ref>3834051</co2ref><h2o>2445989</h2o><h2oref>2419303</h2oref></raw>"


def li850(model: str, inner: str) -> str:
    readings = "<celltemp>51.2</celltemp><cellpres>97.1</cellpres><co2>421.3</co2>"
    return f"<{model}><data>{readings}{inner}</data></{model}>"


@pytest.mark.parametrize(
    "inner",
    [
        RAW,
        "<raw>3787568,3639155</raw>",
        "<co2abs>0.13</co2abs><h2o>6.8</h2o><h2oabs>0.06</h2oabs><h2odewpoint>1.6</h2odewpoint><ivolt>11.9</ivolt>"
        f"{RAW}<flowrate>0.75</flowrate>",
    ],
)
@pytest.mark.parametrize("model", ["li820", "li830", "LI840", "li850"])
def test_li850_reads_through_everything_that_can_be_switched_on(model: str, inner: str) -> None:
    record = li850(model, inner)
    for text in (record, record.upper(), record.replace("><", ">\r\n\t<")):
        sample = one("li850", text)
        assert (sample.state, sample.co2_ppm, sample.pressure_pa) == (
            MEASURING,
            421.3,
            pytest.approx(97_100.0),
        )


@pytest.mark.parametrize(
    "record",
    [
        li850("li850", RAW.replace("</raw>", "")),
        li850("li850", "<co2>9.0</co2>"),
        li850("li850", RAW).replace("<co2>421.3</co2>", "<co2><co2>421.3</co2></co2>"),
        li850("li850", "").replace("<data>", "<data>12"),
    ],
)
def test_li850_damaged_nesting_is_no_reading(record: str) -> None:
    assert [s.state for s in samples("li850", record)] == [ERROR]


def test_li850_counts_are_not_taken_for_co2() -> None:
    only = li850("li850", RAW).replace("<co2>421.3</co2>", "")
    assert "does not send CO2" in one("li850", only).reason


def test_li850_without_names_is_named() -> None:
    found = samples("li850", *["51.2 97.1 421.3 6.8"] * 40)
    assert {s.state for s in found} == {ERROR}
    assert "switch its STRIP off" in found[0].reason


def test_li850_is_told_to_send_names_and_no_echo_under_its_own_name() -> None:
    instrument = make_instrument("li850")
    greeting = instrument.connected(0.0).decode()
    assert "<LI850><RS232><STRIP>FALSE</STRIP></RS232></LI850>\n" in greeting
    assert "<ECHO>FALSE</ECHO>" in greeting
    assert instrument.poll(0.1)[0] == b""
    instrument.receive(0.2, li850("li820", "").encode())
    assert instrument.poll(0.3)[0].decode() == greeting.replace("LI850", "LI820")
    assert instrument.poll(0.4)[0] == b""


def test_li850_questions_and_settings_of_others_say_nothing() -> None:
    settings = "<li850><rs232><co2>true</co2><raw><co2>true</co2></raw></rs232></li850>"
    assert samples("li850", "<li850><data>?</data></li850>", settings, "<li850><ack>true</ack></li850>") == []


# --- GSS ---


def test_gss_output_without_co2_is_named() -> None:
    assert "M 4" in one("cozir", " H 00532 T 01222").reason
    assert samples("cozir", " Y,Jan 30 2013,10:45:03,AL17", " B 00233 00000", " M 00068") == []


def test_gss_every_field_that_can_stand_beside_co2() -> None:
    assert one("cozir", " H 00532 T 01222 D 12345 d 12300 Z 00450 z 00448").co2_ppm == 450.0


# --- anemometers ---


def test_trisonica_without_tags_is_named_and_any_number_of_decimals_reads() -> None:
    assert "switch its tags on" in one("trisonica", "00.08 00.07 245 00.06 00.03 00.05 21.22").reason
    for line in ("U 3 V 4 W 0.500", "U,03.01,V,03.99,W,00.50", "S 5.0249 D 217 U 3.0110 V 3.9900 W 0.50001"):
        assert one("trisonica", line).wind_body_mps == pytest.approx((4.0, 3.0, -0.5), abs=0.02)


def test_windsonic_units_and_addresses() -> None:
    for body in (
        "Q,180,009.72,N,00,",
        "A,180,005.00,M,00,",
        "Z,180,018.00,K,00,",
        "Q,180,011.18,P,00,",
        "Q,180,984.25,F,00,",
    ):
        assert one("windsonic", gill(body)).wind_body_mps == pytest.approx((5.0, 0.0, 0.0), abs=0.01)
    for body in ("WIMWV,180,R,9.72,N,A", "IIMWV,180.0,R,18.0,K,A", "GPMWV,180,R,005.00,M,00"):
        assert one("windsonic", nmea(body)).wind_body_mps == pytest.approx((5.0, 0.0, 0.0), abs=0.01)


def test_windsonic_that_ends_lines_with_cr_only() -> None:
    (sample,) = samples("windsonic", gill("Q,180,005.00,M,00,"), ending="\r")
    assert sample.state is MEASURING


def test_windsonic_start_is_no_fault_and_modes_that_tell_no_wind_are_named() -> None:
    start = (
        "WINDSONIC (Gill Instruments Ltd)",
        "2368-110-01",
        "RS485/RS422 (CFG)",
        "CHECKSUM ROM:E15C E15C *PASS*",
    )
    assert samples("windsonic", *start) == []
    assert "memory" in one("windsonic", "CHECKSUM CAL:C980 C981 *FAIL*").reason
    assert "tunnel" in one("windsonic", gill("Q,001.59,1,M,00,")).reason
    assert "tunnel" in one("windsonic", gill("Q,001.59,0,00,M,")).reason
    assert "configuration mode" in one("windsonic", "CONFIGURATION MODE").reason


# --- what comes, but says nothing ---


@pytest.mark.parametrize(
    ("type_name", "line"),
    [
        ("windsonic", nmea("GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,")),
        ("ft205", "$//,WV?*//"),
        ("li850", "<li850><ack>true</ack></li850>"),
        ("cozir", " M 00004"),
    ],
)
def test_a_line_on_which_only_other_things_come_is_told(type_name: str, line: str) -> None:
    instrument = make_instrument(type_name)
    instrument.connected(0.0)
    told: list[Sample] = []
    for tick in range(300):
        told += instrument.receive(0.1 * tick, f"{line}\r\n".encode())
        told += instrument.poll(0.1 * tick)[1]
    assert told
    assert {s.state for s in told} == {ERROR}
    assert "it sends, but no reading" in told[0].reason


def test_a_device_that_sends_control_characters_writes_none_into_a_terminal() -> None:
    for sample in (
        one("windsonic", gill("Q,180,005.00,M,0\x1b,")),
        one("ft205", nmea("WI,WVP=020.0,045,\x07")),
    ):
        assert sample.state is ERROR
        assert (sample.status + sample.reason).isprintable()
