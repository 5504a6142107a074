"""A fleet's own authority: whose signature makes a node a member. Needs the library `cryptography`.

P-256 keys and X.509 certificates whose common name says who it is. Certificates are valid from 1970 on: a
companion computer without a clock of its own starts with an old date, and must not be kept out for that.
"""

from __future__ import annotations

import datetime
import importlib
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from gcs.errors import GroundError

if TYPE_CHECKING:
    from cryptography import x509
    from cryptography.hazmat.primitives.asymmetric.ec import EllipticCurvePrivateKey

AUTHORITY_VALID: Final = datetime.timedelta(days=20 * 365)
_BEGIN: Final = datetime.datetime(1970, 1, 1, tzinfo=datetime.UTC)


class Pair(NamedTuple):
    """A certificate and its private key, both PEM."""

    certificate: bytes
    private_key: bytes


def check_library() -> None:
    """`GroundError` if what is needed for keys is not installed."""
    try:
        importlib.import_module("cryptography")
    except ImportError as error:
        raise GroundError(
            "keys need the library cryptography, which only the ground installs: pip install '.[ground]'"
        ) from error


def new_authority(fleet: str, now: datetime.datetime) -> Pair:
    """An authority that signs for `fleet` and signs itself."""
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes

    key = _new_key()
    name = _name(f"authority of {fleet}")
    usage = _usage(key_cert_sign=True, crl_sign=True)
    certificate = (
        _builder(name, name, key, now + AUTHORITY_VALID)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(usage, critical=True)
        .sign(key, hashes.SHA256())
    )
    return _pair(certificate, key)


def sign(
    authority: Pair,
    name: str,
    now: datetime.datetime,
    valid: datetime.timedelta,
    private_key: bytes | None = None,
) -> Pair:
    """A certificate for the node `name`, of its present private key or of a new one.

    Raises `GroundError` if the authority's files are damaged, or it would end before the certificate.
    """
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes
    from cryptography.hazmat.primitives.asymmetric.ec import EllipticCurvePrivateKey
    from cryptography.hazmat.primitives.serialization import load_pem_private_key
    from cryptography.x509.oid import ExtendedKeyUsageOID

    def read(pem: bytes, of: str) -> EllipticCurvePrivateKey:
        try:
            key = load_pem_private_key(pem, None)
        except (ValueError, TypeError) as error:
            raise GroundError(f"the private key of {of} is damaged or protected by a pass phrase") from error
        if not isinstance(key, EllipticCurvePrivateKey):
            raise GroundError(f"the private key of {of} is not of the kind that gcs fleet makes")
        return key

    try:
        issuer = x509.load_pem_x509_certificate(authority.certificate)
    except ValueError as error:
        raise GroundError("the authority's certificate is damaged") from error
    signer = read(authority.private_key, "the authority")
    if issuer.public_key() != signer.public_key():
        raise GroundError("the authority's private key does not belong to its certificate")
    if now + valid > issuer.not_valid_after_utc:
        raise GroundError(
            f"the authority itself ends on {issuer.not_valid_after_utc:%Y-%m-%d}; choose fewer --days, or begin anew "
            "with gcs fleet init --force"
        )
    key = _new_key() if private_key is None else read(private_key, name)
    usages: Sequence[Any] = (ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH)
    certificate = (
        _builder(_name(name), issuer.subject, key, now + valid)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_usage(digital_signature=True), critical=True)
        .add_extension(x509.ExtendedKeyUsage(usages), critical=False)
        .sign(signer, hashes.SHA256())
    )
    return _pair(certificate, key)


def _new_key() -> EllipticCurvePrivateKey:
    from cryptography.hazmat.primitives.asymmetric import ec

    return ec.generate_private_key(ec.SECP256R1())


def _name(name: str) -> x509.Name:
    from cryptography import x509
    from cryptography.x509.oid import NameOID

    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])


def _builder(
    subject: x509.Name, issuer: x509.Name, key: EllipticCurvePrivateKey, end: datetime.datetime
) -> x509.CertificateBuilder:
    from cryptography import x509

    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(_BEGIN)
        .not_valid_after(end)
    )


def _usage(
    *, digital_signature: bool = False, key_cert_sign: bool = False, crl_sign: bool = False
) -> x509.KeyUsage:
    from cryptography import x509

    return x509.KeyUsage(
        digital_signature=digital_signature,
        key_cert_sign=key_cert_sign,
        crl_sign=crl_sign,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )


def _pair(certificate: x509.Certificate, key: EllipticCurvePrivateKey) -> Pair:
    from cryptography.hazmat.primitives import serialization

    return Pair(
        certificate.public_bytes(serialization.Encoding.PEM),
        key.private_bytes(
            serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
        ),
    )
