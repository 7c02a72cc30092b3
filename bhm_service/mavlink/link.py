"""One link as it stands: its transport, what is left of its streams, what it was asked for, its counters."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

from bhm_service.mavlink.frames import FrameSplitter
from bhm_service.mavlink.signing import Refusal
from bhm_service.mavlink.subscription import Subscription
from bhm_service.mavlink.transport import LinkUrl, Peer, Transport
from bhm_service.messages import LinkReport, LinkStatus

FIRST_RETRY_S = 0.25  # before a link is opened again
_SPLITTERS = 16


@dataclass(slots=True)
class Link:
    """Kept and changed by `Links`."""

    number: int
    url: LinkUrl
    transport: Transport
    status: LinkStatus = LinkStatus.DOWN
    because: str = ""
    is_open: bool = False
    retry_at_s: float = 0.0
    retry_wait_s: float = FIRST_RETRY_S
    heard_s: float = 0.0
    greeted: bool = False
    splitters: dict[Peer, FrameSplitter] = field(default_factory=dict)
    recent: deque[tuple[float, bytes]] = field(default_factory=lambda: deque(maxlen=64))
    subscription: Subscription = field(default_factory=Subscription)
    bytes_in: int = 0
    frames_in: int = 0
    frames_out: int = 0
    duplicates: int = 0
    opened: int = 0
    stray_bytes: int = 0  # of splitters that are gone
    bad_checksums: int = 0
    refused: dict[Refusal, int] = field(default_factory=lambda: dict.fromkeys(Refusal, 0))
    told_refusal_s: float | None = None

    def splitter(self, peer: Peer) -> FrameSplitter:
        """What is left of this peer's stream."""
        if peer not in self.splitters and len(self.splitters) >= _SPLITTERS:
            self._retire(next(iter(self.splitters)))
        return self.splitters.setdefault(peer, FrameSplitter())

    def forget_streams(self) -> None:
        """What was left of the streams belongs to a connection that is gone."""
        for peer in list(self.splitters):
            self._retire(peer)

    def _retire(self, peer: Peer) -> None:
        gone = self.splitters.pop(peer)
        self.stray_bytes += gone.stray_bytes
        self.bad_checksums += gone.bad_checksums

    def report(self, now_s: float) -> LinkReport:
        """The counters."""
        splitters = self.splitters.values()
        return LinkReport(
            time_s=now_s,
            link=self.number,
            status=self.status,
            bytes_in=self.bytes_in,
            frames_in=self.frames_in,
            frames_out=self.frames_out,
            lost_out=self.transport.lost_frames,
            stray_bytes=self.stray_bytes + sum(s.stray_bytes for s in splitters),
            bad_checksums=self.bad_checksums + sum(s.bad_checksums for s in splitters),
            duplicates=self.duplicates,
            unsigned=self.refused[Refusal.UNSIGNED],
            forged=self.refused[Refusal.FORGED],
            replayed=self.refused[Refusal.REPLAYED],
            opened=self.opened,
            requests=self.subscription.requests,
        )
