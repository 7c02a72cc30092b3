"""Several links at once to one vehicle: bytes to messages, heartbeats and requests back, reconnection without help.

Whatever comes over a wire raises nothing here; it is counted. A message that arrives on two links is taken from the
one that bears it, and from the other when that falls silent.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

from bhm_service.errors import BadInputError
from bhm_service.mavlink.decode import WANTED, VehicleDecoder
from bhm_service.mavlink.encode import COMPONENT, FrameEncoder
from bhm_service.mavlink.frames import WireFrame
from bhm_service.mavlink.link import FIRST_RETRY_S, Link
from bhm_service.mavlink.signing import Signer
from bhm_service.mavlink.transport import LinkDownError, LinkUrl, wait_for
from bhm_service.mavlink.transports import transport_of
from bhm_service.messages import (
    AutopilotClock,
    AutopilotKind,
    Event,
    EventCode,
    Heartbeat,
    LinkReport,
    LinkState,
    LinkStatus,
    Message,
    ParameterValue,
    Severity,
)

_BEAT_S = 1.0
_LAST_RETRY_S = 4.0  # longest wait before a link is opened again
_SILENT_S = 5.0  # without a heartbeat, of which there is one a second
_BEARER_S = 3.0
_DUPLICATE_S = 0.5
_REBOOT_S = 5.0  # frames overtake each other by less
_REFUSED_TELL_S = 60.0
_SETTING_ASKED = 5  # times, once a second: one that does not exist is not answered


class Links:
    """All links of the service.

    ``system`` is the vehicle to follow; the first whose autopilot is heard where it is None. ``key`` turns signing on:
    then nothing unsigned is believed. ``settings`` are parameters that ArduPilot is asked for when it appears.
    ``clock`` times the messages, ``wall`` (Unix seconds) only signatures.
    Raises BadInputError for a URL that cannot be and, unless ``patient``, for a UDP or TCP port of ours that cannot be
    had now.
    """

    def __init__(
        self,
        urls: Sequence[str],
        system: int | None = None,
        component: int = COMPONENT,
        key: bytes | None = None,
        settings: Sequence[str] = (),
        patient: bool = False,
        clock: Callable[[], float] = time.monotonic,
        wall: Callable[[], float] = time.time,
    ) -> None:
        self._clock, self._wall = clock, wall
        self._signer = None if key is None else Signer(key)
        self._decoder = VehicleDecoder(system)
        self._component = component
        # Routers and autopilots forward only to where somebody has spoken, so we speak before we know the vehicle.
        self.encoder = FrameEncoder(system or 1, component)
        self._bearers: dict[int, tuple[int, float]] = {}
        self._boot_s: float | None = None
        self._unasked = dict.fromkeys(settings, _SETTING_ASKED)  # how often each may still be asked for
        self._clock_refused = False
        self._beat_s = self._report_s = clock()
        self._links = [Link(n, url, transport_of(url)) for n, url in enumerate(map(LinkUrl.parse, urls))]
        self._said: list[tuple[int, Message]] = []
        for link in self._links:
            self._open(link, self._beat_s)
            if not link.is_open and not patient and link.url.kind in ("udpin", "tcpin"):
                self.close()
                raise BadInputError(f"link {link.url.text}", link.because)

    @property
    def vehicle(self) -> tuple[int, int] | None:
        """System and component of the autopilot that is followed, once it was heard."""
        if self._decoder.system is None or self._decoder.component is None:
            return None
        return self._decoder.system, self._decoder.component

    @property
    def reports(self) -> list[LinkReport]:
        """The counters of every link, now."""
        return [link.report(self._clock()) for link in self._links]

    def poll(self, timeout_s: float) -> list[tuple[int, Message]]:
        """Messages that came, each with the number of its link, after at most ``timeout_s``; never raises.

        Heartbeats, requests and reconnections happen in here: call it at least a few times a second.
        """
        until = self._clock() + timeout_s
        while True:
            now = self._clock()
            self._upkeep(now)
            wakes = [until, self._beat_s, *(link.retry_at_s for link in self._links if not link.is_open)]
            wait_s = 0.0 if self._said else min(wakes) - now
            told = wait_for([link.transport for link in self._links if link.is_open], wait_s)
            now = self._clock()
            for link in self._links:
                if link.transport in told:
                    self._receive(link, now)
            if self._said or now >= until:
                break
        said, self._said = self._said, []
        return said

    def send(self, frame: bytes) -> None:
        """Send an unsigned frame of `encoder` on every link that is up; signed there if there is a key."""
        for link in self._links:
            self._send(link, frame)

    def close(self) -> None:
        """Give ports and devices back."""
        for link in self._links:
            link.transport.close()
            link.is_open = False

    # ---- going out ---------------------------------------------------------------------------------------------

    def _send(self, link: Link, frame: bytes) -> None:
        if not link.is_open or not link.transport.ready:
            return
        if self._signer is not None:
            unix = self._wall()
            if not self._signer.clock_is_set(unix):
                return
            frame = self._signer.sign(frame, link.number, unix)
        link.transport.send(frame)
        link.frames_out += 1

    def _upkeep(self, now: float) -> None:
        for link in self._links:
            if not link.is_open and now >= link.retry_at_s:
                self._open(link, now)
            if link.is_open and not link.transport.ready:
                self._receive(link, now)  # still being opened: it may have failed, or given up
            if link.is_open and link.transport.ready and not link.greeted:
                link.greeted = True
                self._came_up(link, now)
            if link.status is LinkStatus.ALIVE and now - link.heard_s > _SILENT_S:
                self._state(link, LinkStatus.OPEN, now, f"no heartbeat of the autopilot for {_SILENT_S:.0f} s")
        if now < self._beat_s:
            return
        self._beat_s = max(self._beat_s + _BEAT_S, now)
        self._check_clock(now)
        self.send(self.encoder.companion_heartbeat())
        vehicle = self.vehicle
        for link in self._links:
            if vehicle is not None and link.status is LinkStatus.ALIVE:
                for frame in link.subscription.frames(self.encoder, vehicle, now):
                    self._send(link, frame)
            self._say(link, link.report(now))
        if vehicle is not None and self._decoder.kind is AutopilotKind.ARDUPILOT:
            for name in [name for name, times in self._unasked.items() if times > 0]:
                self._unasked[name] -= 1
                self.send(self.encoder.request_parameter(*vehicle, name))

    def _check_clock(self, now: float) -> None:
        refused = self._signer is not None and not self._signer.clock_is_set(self._wall())
        if refused and not self._clock_refused:
            day = time.strftime("%Y-%m-%d", time.gmtime(max(self._wall(), 0.0)))
            text = f"the clock is not set (it says {day}): nothing is signed or believed until it is"
            self._event(self._links[0], now, Severity.WARNING, text)
        self._clock_refused = refused

    # ---- up and down -------------------------------------------------------------------------------------------

    def _open(self, link: Link, now: float) -> None:
        try:
            link.transport.open()
        except LinkDownError as why:
            self._went_down(link, now, str(why))
            return
        link.is_open = True
        link.greeted = False

    def _came_up(self, link: Link, now: float) -> None:
        link.opened += 1
        self._state(link, LinkStatus.OPEN, now, "")
        self._send(link, self.encoder.companion_heartbeat())

    def _went_down(self, link: Link, now: float, because: str) -> None:
        link.transport.close()
        link.forget_streams()
        link.is_open = False
        link.retry_at_s = now + link.retry_wait_s
        link.retry_wait_s = min(2.0 * link.retry_wait_s, _LAST_RETRY_S)
        if link.status is not LinkStatus.DOWN or link.because != because:
            self._state(link, LinkStatus.DOWN, now, because)

    def _state(self, link: Link, status: LinkStatus, now: float, because: str) -> None:
        link.status, link.because = status, because
        self._say(link, LinkState(time_s=now, link=link.number, url=link.url.text, status=status, because=because))

    # ---- coming in ---------------------------------------------------------------------------------------------

    def _receive(self, link: Link, now: float) -> None:
        try:
            chunks = link.transport.receive()
        except LinkDownError as why:
            self._went_down(link, now, str(why))
            return
        for peer, data in chunks:
            link.bytes_in += len(data)
            for frame in link.splitter(peer).feed(data):
                link.frames_in += 1
                if self._believed(link, frame, now):
                    self._take(link, frame, now)

    def _believed(self, link: Link, frame: WireFrame, now: float) -> bool:
        """Whether a frame may change anything: checked before it does."""
        if self._signer is None:
            return True
        unix = self._wall()
        if not self._signer.clock_is_set(unix):
            return False
        refusal = self._signer.check(frame.raw, frame.message_id, unix)
        if refusal is None:
            return True
        link.refused[refusal] += 1
        if link.told_refusal_s is None or now - link.told_refusal_s > _REFUSED_TELL_S:
            link.told_refusal_s = now
            text = f"{link.url.text}: a frame of system {frame.source[0]} was refused: {refusal.value}"
            self._event(link, now, Severity.WARNING, text)
        return False

    def _take(self, link: Link, frame: WireFrame, now: float) -> None:
        if frame.message_id not in WANTED:
            return
        if any(raw == frame.raw and now - when < _DUPLICATE_S for when, raw in link.recent):
            link.duplicates += 1
            return
        link.recent.append((now, frame.raw))
        messages = self._decoder.decode(frame.message_id, frame.payload, frame.source, now)
        if not messages:
            return
        self._notice(link, frame, messages, now)
        bearer, when = self._bearers.get(frame.message_id, (link.number, now))
        if bearer == link.number or now - when > _BEARER_S:
            self._bearers[frame.message_id] = (link.number, now)
            for message in messages:
                self._say(link, message)

    def _notice(self, link: Link, frame: WireFrame, messages: Sequence[Message], now: float) -> None:
        """What a message of the vehicle tells of the link that it came by."""
        if frame.source == self.vehicle:
            link.subscription.heard(frame.message_id)
        for message in messages:
            if isinstance(message, Heartbeat):
                self._heard(link, message, now)
            elif isinstance(message, ParameterValue):
                self._unasked.pop(message.name, None)
            elif isinstance(message, AutopilotClock):
                if self._boot_s is not None and message.boot_s < self._boot_s - _REBOOT_S:
                    for each in self._links:  # a boot forgets the rates
                        each.subscription.start(self._decoder.kind, now)
                self._boot_s = message.boot_s

    def _heard(self, link: Link, heartbeat: Heartbeat, now: float) -> None:
        link.heard_s = now
        if self.encoder.system != heartbeat.system:
            self.encoder = FrameEncoder(heartbeat.system, self._component)
        if link.status is not LinkStatus.ALIVE:
            link.retry_wait_s = FIRST_RETRY_S
            link.subscription.start(heartbeat.kind, now)
            self._beat_s = min(self._beat_s, now)  # a heartbeat of the right system and the requests go out at once
            said = f"{heartbeat.kind.value}, system {heartbeat.system}"
            self._state(link, LinkStatus.ALIVE, now, said)

    def _event(self, link: Link, now: float, severity: Severity, text: str) -> None:
        self._say(link, Event(time_s=now, app="links", code=EventCode.SIGNING, severity=severity, text=text))

    def _say(self, link: Link, message: Message) -> None:
        self._said.append((link.number, message))
