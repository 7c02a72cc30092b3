"""Every kind of link by its name."""

from __future__ import annotations

from bhm_service.mavlink.serial_port import SerialTransport
from bhm_service.mavlink.tcp import TcpServerTransport, TcpTransport
from bhm_service.mavlink.transport import LinkUrl, Transport
from bhm_service.mavlink.udp import UdpTransport

_KINDS: dict[str, type[Transport]] = {
    "serial": SerialTransport,
    "udpin": UdpTransport,
    "udpout": UdpTransport,
    "tcp": TcpTransport,
    "tcpin": TcpServerTransport,
}


def transport_of(url: LinkUrl) -> Transport:
    """The transport of a link, not yet open."""
    return _KINDS[url.kind](url)
