"""Brings the sentences of one epoch together, in whatever order a receiver sends them and whichever it leaves out.

Sentences with a time belong to their time. Those without (VTG, GSA) belong to the epoch they follow; only types that
a log has before its first sentence with a time are sent ahead, and belong to the epoch they precede (u-blox receivers
send VTG ahead of GGA). So a log is taken to begin with an epoch's first sentence: sentences come in bursts, and a port
is mostly opened in the silence between two. Of one that begins within a burst, speeds are an epoch late or early. A
second sentence of a type within an epoch is passed over (but GSA, which comes once for each constellation).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence

from twin.formats.bad_lines import MISSING, BadLineError
from twin.formats.nmea import fields_of, time_of_day_ns
from twin.formats.nmea_epoch import Epoch
from twin.formats.nmea_sentences import TIMED, UNTIMED
from twin.formats.panda import AGOPENGPS, read_panda

NOT_NMEA = "not NMEA"
REPEATED = "repeated"
_LONGEST_TYPE = 5


class EpochGroups:
    """The epoch that is being put together.

    Args:
        problems: where what cannot be used is counted.
        separation_m: mean sea level above the ellipsoid, until the log says it.
    """

    def __init__(self, problems: Counter[str], separation_m: float) -> None:
        self._problems = problems
        self._separation_m = separation_m
        self._epoch: Epoch | None = None
        self._begun = False
        self._ahead: set[bytes] = set()
        """Untimed types that are sent ahead of their epoch."""
        self._waiting: dict[bytes, Sequence[bytes]] = {}
        """Those of them that have come, by type, for the next sentence with a time."""

    def take(self, text: bytes) -> Epoch | None:
        """Take what follows a ``$``; return the epoch before, if this begins another.

        Raises:
            BadLineError: it cannot be used.
        """
        fields = fields_of(text)
        name = fields[0]
        if name in AGOPENGPS:
            return self._take_timed(name, fields, 1)
        kind = name[2:]
        if kind in TIMED and len(name) == _LONGEST_TYPE:
            return self._take_timed(kind, fields, TIMED[kind][0])
        if kind in UNTIMED and len(name) == _LONGEST_TYPE:
            self._take_untimed(kind, fields)
        return None

    def _take_timed(self, kind: bytes, fields: Sequence[bytes], place: int) -> Epoch | None:
        self._begun = True
        if len(fields) <= place:
            raise BadLineError(MISSING)
        time_ns = time_of_day_ns(fields[place])
        before = None
        if self._epoch is None or self._epoch.time_of_day_ns != time_ns:
            before = self._epoch
            self._epoch = Epoch(time_ns, self._separation_m if before is None else before.separation_m)
        epoch = self._epoch
        try:
            if kind in epoch.seen:
                self._problems[REPEATED] += 1
            elif kind in AGOPENGPS:
                read_panda(epoch, fields)
                epoch.seen.add(kind)
            else:
                TIMED[kind][1](epoch, fields)
                epoch.seen.add(kind)
        except BadLineError as error:
            self._problems[error.kind] += 1  # the epoch before is still to be handed on
        if self._waiting:
            self._take_waiting(epoch)
        return before

    def _take_waiting(self, epoch: Epoch) -> None:
        waiting, self._waiting = self._waiting, {}
        for kind, fields in waiting.items():
            try:
                UNTIMED[kind](epoch, fields)
            except BadLineError as error:
                self._problems[error.kind] += 1
            epoch.seen.add(kind)

    def _take_untimed(self, kind: bytes, fields: Sequence[bytes]) -> None:
        if not self._begun:
            self._ahead.add(kind)
        if kind in self._ahead:
            self._waiting.setdefault(kind, fields)
        elif self._epoch is not None:
            if kind in self._epoch.seen and kind != b"GSA":
                self._problems[REPEATED] += 1
            else:
                self._epoch.seen.add(kind)
                UNTIMED[kind](self._epoch, fields)

    def finish(self) -> Epoch | None:
        """The last epoch."""
        return self._epoch


def epochs(lines: Iterable[bytes], problems: Counter[str], *, separation_m: float) -> Iterator[Epoch]:
    """Epochs of a log's lines, those without any word on a position left out.

    A line may hold several sentences, whole ones and pieces, between other bytes. A separation of sea and ellipsoid
    holds until another is told, and ``separation_m`` until the first is.
    """
    groups = EpochGroups(problems, separation_m)
    for line in lines:
        texts = line.split(b"$")
        if len(texts) == 1:
            problems[NOT_NMEA] += 1
            continue
        for text in texts[1:]:
            try:
                done = groups.take(text)
            except BadLineError as error:
                problems[error.kind] += 1
                continue
            if done is not None and done.place_by:
                yield done
    last = groups.finish()
    if last is not None and last.place_by:
        yield last
