"""Whether a node's certificate will be believed: asked before take-off, answered in one line.

The node shakes hands with itself, in memory, with the standard library's TLS: what cannot be read, does not belong
together, is signed by another authority or has expired shows as it would between two nodes.
"""

from __future__ import annotations

import datetime
import logging
import pathlib
import ssl
import stat
from collections.abc import Iterator
from typing import Any, Final

import msgspec

from flightstack.config import SwarmConfig, TlsConfig
from flightstack.transport import TransportError
from flightstack.transport.access_rules import common_name

log = logging.getLogger(__name__)

_IGNORE_TIME: Final = 0x200000
"""OpenSSL's X509_V_FLAG_NO_CHECK_TIME: the dates are compared here, so that they can be told."""
_SOON: Final = datetime.timedelta(days=14)
_FILES: Final = ("authority", "certificate", "private_key")
_OTHERS: Final = stat.S_IRWXG | stat.S_IRWXO
_FLIGHTS: Final = 10
"""More than the messages of a handshake that go to and fro."""


def check_certificates(
    tls: TlsConfig, node: int | str | None = None, now: datetime.datetime | None = None
) -> datetime.datetime:
    """Until when `node`, or whoever it is, will be believed. `TransportError` says in one line why it will not be."""
    check_readable(tls)
    shown, authority = _handshake(tls)
    name = _common_name(shown)
    expected = name if node is None else common_name(node)
    if name != expected:
        raise TransportError(
            f"swarm.tls: {tls.certificate} is the certificate of {name!r}, this is {expected!r}; "
            "give each node the files that were made for it"
        )
    now = now or datetime.datetime.now(datetime.UTC)
    return min(
        _end(facts, file, now) for facts, file in ((authority, tls.authority), (shown, tls.certificate))
    )


def beside(swarm: SwarmConfig, directory: pathlib.Path) -> SwarmConfig:
    """The same with the certificates' paths from where we are, as they stood in a file of `directory`."""
    if swarm.tls is None:
        return swarm
    files = {field: str(directory / getattr(swarm.tls, field)) for field in _FILES}
    return msgspec.structs.replace(swarm, tls=msgspec.structs.replace(swarm.tls, **files))


def check_files(swarm: SwarmConfig, node: int | str) -> Iterator[str]:
    """Why the node of a configuration file will not be believed; warns in the log when its time is nearly up."""
    if swarm.tls is None:
        return
    try:
        end = check_certificates(swarm.tls, node)
    except TransportError as error:
        yield str(error).removeprefix("swarm.tls: ")
        return
    key = pathlib.Path(swarm.tls.private_key)
    if stat.S_IMODE(key.stat().st_mode) & _OTHERS:
        log.warning("swarm.tls: others can read the private key; chmod 600 %s", key)
    left = end - datetime.datetime.now(datetime.UTC)
    if left < _SOON:
        log.warning("swarm.tls: the certificate expires on %s; renew it before then", f"{end:%Y-%m-%d}")


def check_readable(tls: TlsConfig) -> None:
    """`TransportError` names the file that cannot be read."""
    for field in _FILES:
        _try(getattr(tls, field))


def _try(file: str) -> None:
    try:
        with pathlib.Path(file).open("rb"):
            pass
    except OSError as error:
        raise TransportError(f"swarm.tls: cannot read {file}: {error.strerror}") from error


def _handshake(tls: TlsConfig) -> tuple[dict[str, Any], dict[str, Any]]:
    """What the certificate and the authority say of themselves."""
    server = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    client = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    client.check_hostname = (
        False  # members are known by their common names; addresses change with the network
    )
    client.verify_flags |= _IGNORE_TIME
    try:
        client.load_verify_locations(tls.authority)
    except ssl.SSLError as error:
        raise TransportError(f"swarm.tls: {tls.authority} holds no certificate (PEM)") from error
    try:
        server.load_cert_chain(tls.certificate, tls.private_key, password=_no_password)
    except ssl.SSLError as error:
        raise TransportError(f"swarm.tls: {_pair_problem(tls, error)}") from error
    authorities = client.get_ca_certs()
    if not authorities:
        raise TransportError(f"swarm.tls: {tls.authority} is no authority's certificate")
    to_server, to_client = ssl.MemoryBIO(), ssl.MemoryBIO()
    asking = client.wrap_bio(to_client, to_server)
    answering = server.wrap_bio(to_server, to_client, server_side=True)
    try:
        for _ in range(_FLIGHTS):
            if all([_step(asking), _step(answering)]):
                break
    except ssl.SSLCertVerificationError as error:
        raise TransportError(
            f"swarm.tls: {tls.certificate} is not signed by the authority in {tls.authority} "
            f"({error.verify_message}); both must be of one fleet"
        ) from error
    except ssl.SSLError as error:
        raise TransportError(f"swarm.tls: {tls.certificate} cannot be used: {error.reason}") from error
    shown = asking.getpeercert() or {}
    # A file may hold an old authority beside the new one.
    signed_by = next(a for a in authorities if a["subject"] == shown["issuer"])
    return shown, dict(signed_by)


def _step(end: ssl.SSLObject) -> bool:
    """Whether this end's handshake is done."""
    try:
        end.do_handshake()
    except ssl.SSLWantReadError:
        return False
    return True


def _no_password() -> str:
    """Instead of a question on the terminal, which nobody answers on a drone."""
    return ""


def _pair_problem(tls: TlsConfig, error: ssl.SSLError) -> str:
    if error.reason == "KEY_VALUES_MISMATCH":
        return f"the key in {tls.private_key} does not belong to the certificate in {tls.certificate}"
    text = pathlib.Path(tls.private_key).read_text(encoding="utf-8", errors="replace")
    if "ENCRYPTED" in text:
        return f"{tls.private_key} is protected by a pass phrase, which nobody can give on a drone"
    if "PRIVATE KEY-----" not in text:
        return f"{tls.private_key} holds no private key (PEM)"
    return f"{tls.certificate} holds no certificate (PEM), or {tls.private_key} is damaged"


def _common_name(facts: dict[str, Any]) -> str:
    """The first, as zenoh takes it."""
    names = (value for part in facts.get("subject", ()) for key, value in part if key == "commonName")
    return next(names, "")


def _end(facts: dict[str, Any], file: str, now: datetime.datetime) -> datetime.datetime:
    begin, end = (_time(facts[field]) for field in ("notBefore", "notAfter"))
    if now > end:
        raise TransportError(
            f"swarm.tls: {file} has expired on {end:%Y-%m-%d}; renew it (gcs fleet renew), or set this computer's "
            f"clock, which says {now:%Y-%m-%d}"
        )
    if now < begin:
        raise TransportError(
            f"swarm.tls: {file} is valid from {begin:%Y-%m-%d} on; this computer's clock says {now:%Y-%m-%d}"
        )
    return end


def _time(text: str) -> datetime.datetime:
    return datetime.datetime.fromtimestamp(ssl.cert_time_to_seconds(text), datetime.UTC)
