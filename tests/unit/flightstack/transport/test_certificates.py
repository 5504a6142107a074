"""Certificates that nobody would believe are told before take-off, in one line each."""

from __future__ import annotations

import datetime
import logging
import pathlib

import msgspec
import pytest
from cryptography.hazmat.primitives import serialization

from flightstack.config import SwarmConfig, TlsConfig
from flightstack.transport import TransportError
from flightstack.transport.certificates import beside, check_certificates, check_files
from gcs.keys.authority import new_authority, sign

NOW = datetime.datetime(2026, 6, 1, 12, 0, tzinfo=datetime.UTC)
DAY = datetime.timedelta(days=1)


@pytest.fixture
def made(tmp_path) -> pathlib.Path:
    """Files of drones 1 and 2 of one fleet, and of drone 1 of another."""
    for fleet in ("own", "other"):
        authority = new_authority(fleet, NOW)
        (tmp_path / f"{fleet}.pem").write_bytes(authority.certificate)
        for drone in (1, 2):
            pair = sign(authority, f"drone-{drone}", NOW, 30 * DAY)
            (tmp_path / f"{fleet}-{drone}.pem").write_bytes(pair.certificate)
            (tmp_path / f"{fleet}-{drone}.key").write_bytes(pair.private_key)
    return tmp_path


def tls(
    directory: pathlib.Path, authority="own.pem", certificate="own-1.pem", private_key="own-1.key"
) -> TlsConfig:
    return TlsConfig(
        authority=str(directory / authority),
        certificate=str(directory / certificate),
        private_key=str(directory / private_key),
    )


def problem(files: TlsConfig, node: int | str = 1, now: datetime.datetime = NOW) -> str:
    with pytest.raises(TransportError) as caught:
        check_certificates(files, node, now)
    text = str(caught.value)
    assert text.startswith("swarm.tls: ")
    assert "\n" not in text
    return text


def test_good_certificates_say_until_when(made):
    assert check_certificates(tls(made), 1, NOW) == NOW + 30 * DAY


def test_a_clock_that_starts_in_1970_keeps_nobody_out(made):
    old = datetime.datetime(1970, 1, 2, tzinfo=datetime.UTC)
    assert check_certificates(tls(made), 1, old) == NOW + 30 * DAY


def test_expired(made):
    text = problem(tls(made), now=NOW + 31 * DAY)
    assert "own-1.pem has expired on 2026-07-01; renew it" in text


def test_an_authority_that_has_expired(made):
    text = problem(tls(made), now=NOW + 21 * 365 * DAY)
    assert "own.pem has expired" in text


def test_of_several_authorities_the_one_that_signed_counts(made):
    old = new_authority("old", NOW - 21 * 365 * DAY)
    both = old.certificate + (made / "own.pem").read_bytes()
    (made / "both.pem").write_bytes(both)
    assert check_certificates(tls(made, authority="both.pem"), 1, NOW) == NOW + 30 * DAY


def test_whoever_it_is(made):
    assert (
        check_certificates(tls(made, certificate="own-2.pem", private_key="own-2.key"), now=NOW)
        == NOW + 30 * DAY
    )


def test_a_key_that_others_can_read_is_told(made, caplog):
    authority = new_authority("s", datetime.datetime.now(datetime.UTC))
    pair = sign(authority, "drone-1", datetime.datetime.now(datetime.UTC), 30 * DAY)
    (made / "own.pem").write_bytes(authority.certificate)
    (made / "own-1.pem").write_bytes(pair.certificate)
    (made / "own-1.key").write_bytes(pair.private_key)
    swarm = SwarmConfig(name="s", members=(1,), tls=tls(made))
    for mode, warnings in ((0o600, 0), (0o400, 0), (0o640, 1), (0o604, 1)):
        (made / "own-1.key").chmod(mode)
        caplog.clear()
        assert list(check_files(swarm, 1)) == []
        assert caplog.text.count(f"chmod 600 {made / 'own-1.key'}") == warnings


def test_of_another_fleet(made):
    text = problem(tls(made, certificate="other-1.pem", private_key="other-1.key"))
    assert "other-1.pem is not signed by the authority in" in text


def test_a_key_that_does_not_fit(made):
    assert "own-2.key does not belong to the certificate in" in problem(tls(made, private_key="own-2.key"))


def test_another_drones_files(made):
    text = problem(tls(made, certificate="own-2.pem", private_key="own-2.key"))
    assert "own-2.pem is the certificate of 'drone-2', this is 'drone-1'" in text
    assert "this is 'ground'" in problem(tls(made), "ground")


@pytest.mark.parametrize("field", ["authority", "certificate", "private_key"])
def test_files_that_are_missing_or_directories(made, field):
    good = tls(made)
    gone = msgspec.structs.replace(good, **{field: str(made / "gone")})
    assert "gone: No such file" in problem(gone)
    assert "Is a directory" in problem(msgspec.structs.replace(good, **{field: str(made)}))


@pytest.mark.parametrize("content", [b"", b"nonsense", b"\xff" * 100, b"-----BEGIN CERTIFICATE-----\nAA\n"])
@pytest.mark.parametrize(
    ("field", "text"),
    [
        ("authority", "holds no certificate"),
        ("certificate", "holds no certificate"),
        ("private_key", "holds no private"),
    ],
)
def test_files_that_hold_something_else(made, content, field, text):
    (made / "bad").write_bytes(content)
    assert text in problem(msgspec.structs.replace(tls(made), **{field: str(made / "bad")}))


def test_a_certificate_that_is_no_authoritys(made):
    assert "own-1.pem is no authority's certificate" in problem(tls(made, authority="own-1.pem"))


def test_a_key_with_a_pass_phrase_asks_nobody(made):
    key = serialization.load_pem_private_key((made / "own-1.key").read_bytes(), None)
    (made / "locked").write_bytes(
        key.private_bytes(
            serialization.Encoding.PEM,
            serialization.PrivateFormat.PKCS8,
            serialization.BestAvailableEncryption(b"secret"),
        )
    )
    assert "is protected by a pass phrase" in problem(tls(made, private_key="locked"))


def test_a_damaged_key(made):
    text = (made / "own-1.key").read_text()
    (made / "half").write_text(text[: len(text) // 2])
    assert "half is damaged" in problem(tls(made, private_key="half"))


def test_a_files_problem_and_what_ends_soon(made, caplog):
    swarm = SwarmConfig(name="s", members=(1,), tls=tls(made))
    authority = new_authority("s", datetime.datetime.now(datetime.UTC))
    pair = sign(authority, "drone-1", datetime.datetime.now(datetime.UTC), 3 * DAY)
    (made / "own.pem").write_bytes(authority.certificate)
    assert [text.split(" is not signed")[0] for text in check_files(swarm, 1)] == [str(made / "own-1.pem")]
    (made / "own-1.pem").write_bytes(pair.certificate)
    (made / "own-1.key").write_bytes(pair.private_key)
    with caplog.at_level(logging.WARNING):
        assert list(check_files(swarm, 1)) == []
    assert "the certificate expires on" in caplog.text
    assert list(check_files(SwarmConfig(name="s", members=(1,)), 1)) == []


def test_paths_are_relative_to_their_file():
    files = TlsConfig(authority="a.pem", certificate="sub/c.pem", private_key="/etc/k.key")
    swarm = beside(SwarmConfig(name="s", members=(1,), tls=files), pathlib.Path("/cfg"))
    assert swarm.tls == TlsConfig(
        authority="/cfg/a.pem", certificate="/cfg/sub/c.pem", private_key="/etc/k.key"
    )
    plain = SwarmConfig(name="s", members=(1,))
    assert beside(plain, pathlib.Path("/cfg")) is plain
