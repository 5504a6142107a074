"""Every instrument against a transcript built from its public protocol document (cited in its module)."""

from __future__ import annotations

import pytest

from sensors.instruments.checksums import modbus_crc, xor_checksum
from sensors.instruments.registry import INSTRUMENTS, make_instrument
from sensors.instruments.samples import InstrumentState, Quantity, Sample
from sensors.instruments.sensor_error import SensorError

MEASURING, WARMING, ZEROING = InstrumentState.MEASURING, InstrumentState.WARMING, InstrumentState.ZEROING
ERROR, SILENT = InstrumentState.ERROR, InstrumentState.SILENT


def nmea(body: bytes) -> bytes:
    return b"$%s*%02X\r\n" % (body, xor_checksum(body))


def gill(body: bytes) -> bytes:
    return b"\x02%s\x03%02X\r\n" % (body, xor_checksum(body))


def modbus(body: str) -> bytes:
    data = bytes.fromhex(body)
    return data + modbus_crc(data)


def one(type_name: str, data: bytes, **options: object) -> Sample:
    samples = make_instrument(type_name, "it", options).receive(1.0, data)
    assert len(samples) == 1, samples
    return samples[0]


# -- SBA-5
# ------------------------------------------------------------------------------------------------------


def test_sba5_start_from_power_up_to_readings() -> None:
    transcript = (
        b"!\r\nC2\r\nOK\r\nP1\r\nOK\r\nA120\r\nOK\r\n"
        b"W,23.4\r\nW,54.9\r\n"
        b"Z,1 of 25\r\nM 50885 48094 500.96 55.0 0.0 0.0 829 55.0 55.0 00\r\nZ,25 of 25\r\n"
        b"M 50885 48094 500.96 55.0 0.0 0.0 829 55.0 55.0 00\r\n"
        b"M,50885,48094,501.02,55.0,0.0,0.0,829,00\r\n"
    )
    samples = make_instrument("sba5", "co2").receive(3.0, transcript)
    assert [s.state for s in samples] == [WARMING, WARMING, ZEROING, ZEROING, ZEROING, MEASURING, MEASURING]
    assert samples[1].reason == "warming up, 54.9 C"
    assert samples[2].reason == samples[3].reason == "zeroing 1 of 25", "a reading within a zero is none"
    assert (samples[5].co2_ppm, samples[6].co2_ppm) == (500.96, 501.02)
    assert samples[5].status == "00"
    assert samples[5].pressure_pa == pytest.approx(82_900.0)
    assert all(s.quantity is Quantity.CO2 and s.time_s == 3.0 for s in samples)


@pytest.mark.parametrize(
    ("status", "word"),
    [
        ("01", "low detector counts"),
        ("02", "too cold"),
        ("03", "too hot"),
        ("04", "low alarm"),
        ("05", "humidity"),
        ("06", "voltage"),
        ("09", "unknown status"),
    ],
)
def test_sba5_only_status_0_is_a_reading(status: str, word: str) -> None:
    sample = one("sba5", f"M 50885 48094 500.96 55.0 0.0 0.0 829 55.0 55.0 {status}\r\n".encode())
    assert (sample.state, sample.status, sample.co2_ppm) == (ERROR, status, None)
    assert word in sample.reason


@pytest.mark.parametrize(
    "line",
    [
        b"M 50885 500.96 55.0 0.0 0.0 829 55.0 55.0 00",  # one field lost
        b"M 50885 48094 500.96 55.0 0.0 829 55.0 55.0 00",
        b"M 508M 50885 48094 500.96 55.0 0.0 0.0 829 55.0 55.0 00",
        b"M 50885 48094 nan 55.0 0.0 0.0 829 55.0 55.0 00",
        b"M 50885 48094 inf 55.0 0.0 0.0 829 55.0 55.0 00",
        b"M 50885 48094 5e2 55.0 0.0 0.0 829 55.0 55.0 00",
        b"M 50885 48094 -3.20 55.0 0.0 0.0 829 55.0 55.0 00",
        b"M 50885 48094 500.96 55.0 0.0 0.0 55.0 829 55.0 00",  # fields out of place
        b"Z,26 of 25",
        b"W,hot",
        b"S 00.08 D 245 U 00.06 V 00.03 W 00.05",  # another device
    ],
)
def test_sba5_damaged_lines_are_errors_with_a_reason(line: bytes) -> None:
    sample = one("sba5", line + b"\r\n")
    assert (sample.state, sample.co2_ppm) == (ERROR, None)
    assert sample.reason


def test_sba5_end_of_range_is_a_lower_bound_and_no_reading() -> None:
    sample = one("sba5", b"M 50885 48094 2000.00 55.0 0.0 0.0 829 55.0 55.0 00\r\n", range_ppm=2000)
    assert (sample.state, sample.co2_ppm, sample.co2_at_least_ppm) == (ERROR, None, 2000.0)


def test_sba5_greets_polls_and_tells_of_silence() -> None:
    sba5 = make_instrument("sba5")
    assert sba5.connected(0.0) == b"!C2\rP1\rA120\r"
    asked = b"".join(sba5.poll(0.1 * tick)[0] for tick in range(1, 11))
    assert asked == b"M" * 10
    late = [s for tick in range(11, 60) for s in sba5.poll(0.1 * tick)[1]]
    assert [s.state for s in late] == [SILENT, SILENT]
    assert "no answer for" in late[0].reason


def test_sba5_reading_was_made_when_it_was_asked_for() -> None:
    sba5 = make_instrument("sba5")
    sba5.connected(0.0)
    line = b"M 50885 48094 500.96 55.0 0.0 0.0 829 55.0 55.0 00\r\n"
    assert sba5.poll(1.0)[0] == b"M"
    assert sba5.receive(1.13, line)[0].time_s == 1.0
    assert sba5.receive(9.0, line)[0].time_s == 9.0, "not the answer to a question of long ago"


def test_sba5_zeroes_twice_after_a_warm_up_and_never_when_it_was_warm() -> None:
    sba5 = make_instrument("sba5")
    sba5.connected(0.0)
    assert b"Z" not in b"".join(sba5.poll(0.1 * tick)[0] for tick in range(300))
    sba5.receive(30.0, b"W,54.0\r\n")
    sba5.receive(31.0, b"M 50885 48094 500.96 55.0 0.0 0.0 829 55.0 55.0 00\r\n")
    sent_at = []
    for tick in range(310, 4000):
        now_s = 0.1 * tick
        request, _ = sba5.poll(now_s)
        if b"Z" in request:
            sent_at.append(round(now_s))
            sba5.receive(now_s, b"Z,1 of 25\r\nZ,25 of 25\r\n")
        sba5.receive(now_s, b"M 50885 48094 500.96 55.0 0.0 0.0 829 55.0 55.0 00\r\n")
    assert len(sent_at) == 2
    assert sent_at[1] - sent_at[0] == pytest.approx(120.0, abs=1.0)


# -- K30
# --------------------------------------------------------------------------------------------------------


def test_k30_status_and_reading_in_one_reply() -> None:
    k30 = make_instrument("k30")
    k30.connected(0.0)
    assert k30.poll(0.0)[0] == bytes.fromhex("FE0400000004E5C6"), "the request of the protocol document"
    sample = one("k30", modbus("FE04 08 0000 0000 0000 0388"))
    assert (sample.state, sample.co2_ppm, sample.status) == (MEASURING, 904.0, "0x0000")


def test_k30_single_register_and_ram_replies() -> None:
    assert one("k30", modbus("FE04 02 0388")).co2_ppm == 904.0
    assert one("k30", modbus("FE44 02 0190")).co2_ppm == 400.0
    assert one("k30", modbus("FE04 02 0190"), multiplier=10).co2_ppm == 4000.0


@pytest.mark.parametrize(
    ("body", "word"),
    [
        ("FE04 08 0020 0000 0000 0388", "out of range"),
        ("FE04 08 0001 0000 0000 0388", "fatal"),
        ("FE04 08 0100 0000 0000 0388", "unknown status"),
        ("FE84 02", "illegal address"),
        ("FE04 02 FFF0", "negative"),
        ("FE04 02 2710", "saturated"),
    ],
)
def test_k30_faults_are_no_readings(body: str, word: str) -> None:
    sample = one("k30", modbus(body))
    assert (sample.state, sample.co2_ppm) == (ERROR, None)
    assert word in sample.reason


def test_k30_finds_replies_between_noise_echoes_and_damage() -> None:
    reply, damaged = modbus("FE04 08 0000 0000 0000 0190"), bytearray(modbus("FE04 08 0000 0000 0000 0FA0"))
    damaged[8] ^= 0x04
    stream = b"\x00\x13" + bytes.fromhex("FE0400000004E5C6") + bytes(damaged) + reply
    samples = make_instrument("k30").receive(0.0, stream)
    assert [s.co2_ppm for s in samples if s.state is MEASURING] == [400.0]
    assert any(s.state is ERROR for s in samples)


# -- GSS
# --------------------------------------------------------------------------------------------------------


def test_k30_reply_that_is_cut_off_or_of_another_question_is_told() -> None:
    k30 = make_instrument("k30")
    assert k30.receive(0.0, modbus("FE04 08 0000 0000 0000 0190")[:-1]) == []
    assert [s.state for s in k30.ended(0.0)] == [ERROR]
    assert k30.ended(0.0) == []
    assert "nobody here asked" in one("k30", modbus("FE04 04 0000 0190")).reason


def test_gss_multiplier_filtered_and_unfiltered() -> None:
    assert one("cozir", b" Z 00450 z 00448\r\n").co2_ppm == 450.0
    assert one("cozir", b" Z 00450 z 00448\r\n", unfiltered=True).co2_ppm == 448.0
    assert one("sprintir", b" z 00051\r\n").co2_ppm == 510.0
    assert one("sprintir", b" . 00001\r\n Z 00450\r\n").co2_ppm == 450.0
    sample = one("cozir", b" H 00532 T 01222 Z 00450\r\n")
    assert (sample.co2_ppm, sample.temperature_c) == (450.0, pytest.approx(22.2))


def test_gss_on_a_line_guesses_no_multiplier() -> None:
    sensor = make_instrument("sprintir")
    assert sensor.connected(0.0) == b".\r\nM 4\r\nK 1\r\n"
    assert sensor.receive(0.1, b" Z 00042\r\n")[0].state is WARMING
    assert "set the option multiplier" in sensor.receive(3.0, b" Z 00042\r\n")[0].reason
    assert sensor.receive(3.1, b" . 00010\r\n Z 00042\r\n")[0].co2_ppm == 420.0
    conflict = one("cozir", b" . 00010\r\n Z 00042\r\n", multiplier=1)
    assert (conflict.state, conflict.co2_ppm) == (ERROR, None)


@pytest.mark.parametrize(
    "line", [b"?", b" Z 00450 Z 00451", b" Z 4500000", b" Z 0045", b" Z -0045", b"50 z 00448", b" Z"]
)
def test_gss_damaged_lines(line: bytes) -> None:
    sample = one("cozir", line + b"\r\n")
    assert (sample.state, sample.co2_ppm) == (ERROR, None)


def test_gss_acknowledgements_say_nothing() -> None:
    assert make_instrument("cozir").receive(0.0, b" K 00001\r\n M 00004\r\n A 00032\r\n") == []


# -- LI-850
# -----------------------------------------------------------------------------------------------------

LI850 = (
    b"<li850><data><celltemp>5.1230e1</celltemp><cellpres>8.2900e1</cellpres><co2>4.2010e2</co2>"
    b"<co2abs>9.1e-2</co2abs><h2o>8.2</h2o></data></li850>"
)


def test_li850_record_in_either_case_over_several_lines() -> None:
    for record in (
        LI850,
        LI850.upper(),
        LI850.replace(b"><", b">\r\n  <"),
        LI850.replace(b"li850", b"li830"),
    ):
        sample = one("li850", record + b"\r\n")
        assert (sample.state, sample.co2_ppm) == (MEASURING, pytest.approx(420.10))
        assert sample.pressure_pa == pytest.approx(82_900.0)


@pytest.mark.parametrize(
    ("record", "state", "word"),
    [
        (LI850.replace(b"5.1230e1", b"2.4e1"), WARMING, "cell at 24.0 C"),
        (LI850.replace(b"4.2010e2", b"nan"), ERROR, "damaged"),
        (LI850.replace(b"4.2010e2", b"-1.2e1"), ERROR, "negative"),
        (LI850.replace(b"4.2010e2", b"2.5e4"), ERROR, "saturated"),
        (LI850.replace(b"<co2>4.2010e2</co2>", b""), ERROR, "does not send CO2"),
        (LI850.replace(b"</data>", b""), ERROR, "damaged"),
        (b"<li850><error>Invalid XML</error></li850>", ERROR, "invalid xml"),
    ],
)
def test_li850_records_without_a_reading(record: bytes, state: InstrumentState, word: str) -> None:
    sample = one("li850", record)
    assert (sample.state, sample.co2_ppm) == (state, None)
    assert word in sample.reason


def test_li850_record_that_is_cut_off_is_told() -> None:
    li850 = make_instrument("li850")
    assert li850.receive(0.0, LI850 + b"\r\n" + LI850[:60])[0].state is MEASURING
    assert [s.state for s in li850.ended(0.0)] == [ERROR]


def test_li850_lost_ends_and_acknowledgements() -> None:
    samples = make_instrument("li850").receive(0.0, LI850[:60] + LI850 + b"<li850><ack>TRUE</ack></li850>")
    assert [s.state for s in samples] == [ERROR, MEASURING]


# -- readings relayed by the autopilot
# --------------------------------------------------------------------------


def test_mavlink_named_values() -> None:
    from pymavlink.dialects.v20 import common

    sender = common.MAVLink(None, srcSystem=1, srcComponent=1)
    stream = b"".join(
        (
            common.MAVLink_named_value_float_message(1, b"CO2", 431.5).pack(sender),
            b"\x00\x05\xd1\x12tlog time stamp",
            common.MAVLink_named_value_float_message(2, b"SO2", 3.0).pack(sender),
            common.MAVLink_named_value_float_message(3, b"co2", float("nan")).pack(sender),
            common.MAVLink_named_value_float_message(4, b"CO2", -1.0).pack(sender),
        )
    )
    samples = make_instrument("mavlink").receive(0.0, stream)
    assert [s.state for s in samples] == [MEASURING, ERROR, ERROR]
    assert samples[0].co2_ppm == pytest.approx(431.5)


# -- anemometers
# ------------------------------------------------------------------------------------------------

TRISONICA = (
    b"S 05.02 S2 05.00 D 217 DV 006 U 03.01 V 03.99 W 00.50 T 21.22 H 17.92 P 0994.70 PI 011.4 RO 009.8"
)


def test_trisonica_axes_towards_the_nose_right_and_down() -> None:
    sample = one("trisonica", TRISONICA + b"\r\n")
    assert sample.wind_body_mps == pytest.approx((3.99, 3.01, -0.50))
    assert (sample.temperature_c, sample.pressure_pa) == (21.22, pytest.approx(99_470.0))


def test_trisonica_direction_decides_over_the_sign_of_old_firmware() -> None:
    old = TRISONICA.replace(b"U 03.01 V 03.99", b"U -3.01 V -3.99")
    assert one("trisonica", old + b"\r\n").wind_body_mps == pytest.approx((3.99, 3.01, -0.50))


def test_trisonica_speed_and_direction_alone_is_a_flat_wind() -> None:
    sample = one("trisonica", b"S 05.00 D 090 T 21.22\r\n")
    assert sample.wind_body_mps == pytest.approx((0.0, -5.0, 0.0), abs=1e-9)
    assert not sample.wind_down_measured


@pytest.mark.parametrize(
    "line",
    [
        TRISONICA.replace(b"U 03.01", b"U 13.01"),
        TRISONICA.replace(b"D 217", b"D 127"),
        TRISONICA.replace(b"D 217", b"D 417"),
        TRISONICA.replace(b"W 00.50", b"W -99.9"),
        TRISONICA.replace(b"S2 05.00", b"S2"),
        TRISONICA.replace(b"T 21.22", b"U 21.22"),
        b"T 21.22 H 17.92",
        b"U 99.99 V 99.99 W 99.99",
        b"U nan V 0 W 0",
    ],
)
def test_trisonica_lines_that_contradict_themselves(line: bytes) -> None:
    sample = one("trisonica", line + b"\r\n")
    assert (sample.state, sample.wind_body_mps) == (ERROR, None)
    assert sample.reason


def test_ft205_polar_combined_and_nmea_as_the_manual_prints_them() -> None:
    forward = -20.0 * 2**-0.5
    for message in (b"$WI,WVP=020.0,045,0*73\r\n", b"$WIMWV,045,R,020.0,M,A*3D\r\n"):
        sample = one("ft205", message)
        assert sample.wind_body_mps == pytest.approx((forward, forward, 0.0))
        assert not sample.wind_down_measured
    assert one("ft205", b"$WI,WVC=000.0,323,0,+026.3,C,A*4D\r\n").temperature_c == 26.3
    assert one("ft205", nmea(b"WI,WVP=020.0,045,0,+026.3,C,V")).temperature_c == 26.3
    assert one("ft205", nmea(b"WIMWV,000,R,019.4,N,A")).wind_body_mps == pytest.approx(
        (-9.980, 0.0, 0.0), abs=2e-3
    )


@pytest.mark.parametrize(
    ("message", "word"),
    [
        (b"$WI,WVP=020.0,045,0*74\r\n", "check sum"),
        (nmea(b"WI,WVP=020.0,045,1"), "error"),
        (nmea(b"WI,WVP=075.0,045,2"), "overspeed"),
        (nmea(b"WI,WVP=020.0,360,0"), "not an FT205"),
        (nmea(b"WI,WVP=-20.0,045,0"), "not an FT205"),
        (nmea(b"WIMWV,045,T,020.0,M,A"), "relative"),
        (nmea(b"WIMWV,045,R,020.0,M,V"), "void"),
    ],
)
def test_ft205_messages_without_a_reading(message: bytes, word: str) -> None:
    sample = one("ft205", message)
    assert (sample.state, sample.wind_body_mps) == (ERROR, None)
    assert word in sample.reason


def test_a_whole_message_behind_the_rest_of_another_is_read() -> None:
    assert one("ft205", b"$WI,WVP=020.$WI,WVP=020.0,045,0*73\r\n").state is MEASURING
    assert one("windsonic", b"\x02Q,229,00" + gill(b"Q,229,002.74,M,00,")).state is MEASURING
    assert one("windsonic", b"4,M\xff" + nmea(b"WIMWV,229,R,002.74,M,A")).state is MEASURING


def test_ft205_asks_any_sensor_and_ignores_its_own_echo() -> None:
    sensor = make_instrument("ft205")
    sensor.connected(0.0)
    request, _ = sensor.poll(0.0)
    assert request == b"$//,WV?*//\r\n"
    assert sensor.receive(0.1, request) == []


def test_windsonic_formats_agree() -> None:
    assert gill(b"Q,229,002.74,M,00,") == b"\x02Q,229,002.74,M,00,\x0316\r\n", "the manual's example"
    polar = one("windsonic", gill(b"Q,229,002.74,M,00,")).wind_body_mps
    assert polar == pytest.approx((1.798, 2.068, 0.0), abs=1e-3)
    assert one("windsonic", gill(b"Q,+001.80,-002.07,M,00,")).wind_body_mps == pytest.approx(polar, abs=5e-3)
    assert one("windsonic", nmea(b"WIMWV,229,R,002.74,M,A")).wind_body_mps == pytest.approx(polar)
    assert one("windsonic", nmea(b"IIMWV,229,R,002.74,M,00")).wind_body_mps == pytest.approx(polar)
    assert one("windsonic", gill(b"Q,,000.04,M,00,")).wind_body_mps == pytest.approx((-0.04, 0.0, 0.0))


@pytest.mark.parametrize(
    ("message", "word"),
    [
        (b"\x02Q,229,002.74,M,00,\x0317\r\n", "check sum"),
        (gill(b"Q,229,002.74,M,01,"), "axis 1"),
        (gill(b"Q,229,002.74,M,04,"), "both axes"),
        (gill(b"Q,,000.00,M,08,"), "memory"),
        (gill(b"Q,229,099.00,M,00,"), "beyond its range"),
        (gill(b"Q,,002.74,M,00,"), "not a WindSonic"),
        (gill(b"Q,229,002.74,X,00,"), "not a WindSonic"),
        (b"Q,229,002.74,M,00\r\n", "not a WindSonic"),
    ],
)
def test_windsonic_messages_without_a_reading(message: bytes, word: str) -> None:
    sample = one("windsonic", message)
    assert (sample.state, sample.wind_body_mps) == (ERROR, None)
    assert word in sample.reason


def test_mounting_is_removed_once_for_all() -> None:
    """A wind along the nose: an anemometer turned 90 degrees clockwise feels it from its own left."""
    line = b"U -5.00 V 00.00 W 00.00\r\n"  # towards the instrument's west
    assert one("trisonica", line, mount_yaw_deg=90).wind_body_mps == pytest.approx((5.0, 0.0, 0.0), abs=1e-9)
    hung = one("trisonica", b"U 01.00 V 02.00 W 00.50\r\n", upside_down=True)
    assert hung.wind_body_mps == pytest.approx((2.0, -1.0, 0.5))


# -- the table
# --------------------------------------------------------------------------------------------------


def test_types_have_names_that_people_write() -> None:
    for text in (
        "SBA-5",
        "sba5",
        "LI-850",
        "TriSonica Mini",
        "li_550",
        "FT-205",
        "Gill WindSonic",
        "Senseair K30",
    ):
        assert make_instrument(text).kind in INSTRUMENTS
    with pytest.raises(SensorError, match=r"unknown instrument type 'sba-6'; did you mean sba5\?"):
        make_instrument("sba-6")


def test_options_are_checked_and_named() -> None:
    with pytest.raises(SensorError, match=r"instrument co2 \(sba5\): .*unknown field `pol_hz`.*poll_hz"):
        make_instrument("sba5", "co2", {"pol_hz": 5})
    with pytest.raises(SensorError, match="poll_hz"):
        make_instrument("sba5", "co2", {"poll_hz": "often"})
    with pytest.raises(SensorError, match="its options are"):
        make_instrument("windsonic", "mast", {"calibration": {"offset_ppm": 1.0}})
