"""The strapdown filter of one machine: prediction by the fused inertial sample, aids in their true order, modes.

Late samples are taken at the time they are about. The filter keeps its last moments (:class:`Epoch`: what came in, and
the state before); a sample that belongs to a past epoch is put in there and everything since is done again. Within an
epoch the aids are taken sensor by sensor in the model's order, so that the order of arrival makes no difference. States
are replaced, never changed in place, so keeping them costs nothing but memory.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from twin.estimators.engines import Engine, Motion, Observation, innovation
from twin.estimators.inertial_array import Fused
from twin.estimators.ins_model import Drive, ErrorChange, ReceiverModel, Strapdown, doppler
from twin.estimators.ins_observations import NoSlip, Standing
from twin.signals import BoolArray, FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Receiving:
    """The state of a receiver's fix, for R members."""

    model: ReceiverModel
    sigma_m: FloatArray
    """(R,) standard deviation of the correlated error in this state."""
    state: FloatArray
    """(R,) number of the state; another one than before means another error."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AidReading:
    """One thing a sensor tells of one instant, for R members."""

    source: str
    """Name of the innovation, and of what its gate remembers."""
    sensor: str
    observation: Observation
    z: FloatArray
    """(R, m)."""
    mask: BoolArray
    """(R,)."""
    variances: FloatArray
    """(R, m)."""
    speed_source: bool
    """Whether it tells the speed: the last resort if all others are gone."""
    receiver: Receiving | None = None
    """What the receiver says of its fix, for its positions."""


@dataclass(frozen=True, slots=True)
class Modes:
    """What the filter remembers beside its state. Arrays are replaced, never changed in place."""

    braking: Mapping[str, BoolArray]
    """(R,) by pulse sensor: whether its slow lag is at work."""
    difference: Mapping[str, FloatArray]
    """(R,) smoothed input minus output of its lag, m/s."""
    refused_since: Mapping[str, FloatArray]
    """(R,) by innovation: epoch from which on all of it has been refused; NaN if the last was used."""
    used_at: Mapping[str, FloatArray]
    """(R,) by innovation: epoch of the last one that was used."""
    position_sigma_m: Mapping[str, FloatArray]
    """(R,) by receiver: standard deviation of its correlated error."""
    fix_state: Mapping[str, FloatArray]
    """(R,) by receiver: state of its fix in the last sample; NaN before the first."""


@dataclass(slots=True)
class Epoch:
    """One step of the filter and what is known of it."""

    index: int
    dt_s: float
    inertial: Fused
    standing: BoolArray
    """(R,)."""
    aids: list[AidReading] = field(default_factory=list)
    before: tuple[FloatArray, FloatArray, Modes] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class GateConfig:
    """How outliers are told; see :class:`StrapdownFilter`."""

    enabled: bool
    sigmas: float
    reacquire_s: float


class Recorder(Protocol):
    """Keeps every step, for a smoother."""

    def begin(self, index: int) -> None:
        """An epoch begins; what is known of it and of later ones is to be forgotten."""

    def predicted(self, F: FloatArray, x: FloatArray, P: FloatArray) -> None:
        """The state (R, n) and covariance (R, n, n) after a prediction with the Jacobian F (R, n, n)."""

    def corrected(self, x: FloatArray, P: FloatArray) -> None:
        """The same after the updates that followed."""


class StrapdownFilter:
    """Predicts, updates, gates, and goes back for late samples (R members).

    An aid of m components whose normalised innovation squared exceeds ``gate.sigmas`` squared + m - 1 is not used. A
    position that has been refused for ``gate.reacquire_s`` is believed to have a new error: the receiver's correlated
    error is drawn anew with the size of the innovation, so that the fix is used again but does not pull. A speed that
    has been refused for as long is believed again only if no other speed has been accepted either.
    """

    def __init__(
        self,
        *,
        engine: Engine,
        model: Strapdown,
        no_slip: NoSlip,
        standing: Standing,
        gate: GateConfig,
        lag_switch_m_s: float,
        step_s: float,
        history: int,
        speed_sources: Sequence[str],
        recorder: Recorder | None = None,
    ) -> None:
        self.engine = engine
        self.model = model
        runs = len(engine.x)
        self._no_slip = no_slip
        self._standing = standing
        self._gate = gate
        self._lag_switch = lag_switch_m_s
        self._step_s = step_s
        self._everyone = np.ones(runs, dtype=np.bool_)
        self._zero = np.zeros((runs, 3))
        self._epochs: deque[Epoch] = deque(maxlen=history)
        self._recorder = recorder
        self._speed_sources = tuple(speed_sources)
        self.nis: dict[str, FloatArray] = {}
        """Normalised innovation squared (R,) of the last new aid by name, before gating; NaN for none.
        What is done again for a late sample does not count again."""
        none = np.zeros(runs)
        self.modes = Modes(
            braking={sensor.name: np.zeros(runs, dtype=np.bool_) for sensor in model.pulse_sensors},
            difference={sensor.name: none for sensor in model.pulse_sensors},
            refused_since={},
            used_at={},
            position_sigma_m={receiver.name: np.full(runs, 10.0) for receiver in model.receivers},
            fix_state={receiver.name: np.full(runs, np.nan) for receiver in model.receivers},
        )
        sensors = [sensor.name for sensor in model.pulse_sensors] + [receiver.name for receiver in model.receivers]
        self._order = {name: place for place, name in enumerate(sensors)}

    @property
    def index(self) -> int | None:
        """Index of the newest epoch."""
        return self._epochs[-1].index if self._epochs else None

    def step(self, epoch: Epoch) -> None:
        """Take the next epoch."""
        self._epochs.append(epoch)
        self._run(epoch)

    def add(self, index: int, aids: Sequence[AidReading]) -> None:
        """Put aids into the epoch of their time, the oldest kept if that is gone, and do again what came after."""
        if not self._epochs or not aids:
            return
        place = len(self._epochs) - 1
        while place > 0 and self._epochs[place].index > index:
            place -= 1
        epoch, known = self._epochs[place], self._epochs[place].aids
        epoch.aids = sorted([*known, *aids], key=lambda aid: self._order[aid.sensor])
        follow = all(one is other for one, other in zip(known, epoch.aids, strict=False))
        if follow and place == len(self._epochs) - 1:
            for aid in epoch.aids[len(known) :]:
                self._update(aid, epoch.index, new=True)
            self._note_corrected()
            return
        assert epoch.before is not None
        x, P, self.modes = epoch.before
        self.engine.restore(x, P)
        for again in range(place, len(self._epochs)):
            self._run(self._epochs[again], new=aids)

    def _run(self, epoch: Epoch, new: Sequence[AidReading] = ()) -> None:
        """Predict to an epoch and update with all that is known of it; ``new`` has not been taken before."""
        engine, inertial = self.engine, epoch.inertial
        epoch.before = (engine.x, engine.P, self.modes)
        if self._recorder is not None:
            self._recorder.begin(epoch.index)
        self._prepare(epoch)
        rate = self.model.rate(engine.x, inertial.u)
        self._predict(self.model, inertial.u, epoch.dt_s)
        self._switch_lags(rate)
        self._no_slip.rate = rate
        engine.update(self._no_slip, self._zero[:, :2], self._everyone)
        if epoch.standing.any():
            z = np.concatenate([self._zero, inertial.u[:, 3:]], axis=1)
            variances = np.broadcast_to(self._standing.R, z.shape).copy()
            variances[:, 3:] = inertial.gyro_variance[:, np.newaxis]
            engine.update(self._standing, z, epoch.standing, variances)
        for aid in epoch.aids:
            self._update(aid, epoch.index, new=any(aid is each for each in new))
        self._note_corrected()

    def _predict(self, motion: Motion, u: FloatArray, dt_s: float) -> None:
        F = motion.linearise(self.engine.x, u, dt_s)[1] if self._recorder is not None else None
        self.engine.predict(motion, u, dt_s)
        if self._recorder is not None and F is not None:
            self._recorder.predicted(F, self.engine.x, self.engine.P)

    def _note_corrected(self) -> None:
        if self._recorder is not None:
            self._recorder.corrected(self.engine.x, self.engine.P)

    def _prepare(self, epoch: Epoch) -> None:
        """Tell the model what this step is like."""
        lags = {
            sensor.name: np.where(self.modes.braking[sensor.name], sensor.lags_s[1], sensor.lags_s[0])
            for sensor in self.model.pulse_sensors
        }
        self.model.drive = Drive(
            accel_variance=epoch.inertial.accel_variance,
            gyro_variance=epoch.inertial.gyro_variance,
            lags_s=lags,
            position_sigmas_m=self.modes.position_sigma_m,
        )

    def _switch_lags(self, rate: FloatArray) -> None:
        """Follow which of a radar's two time constants is at work: the sign of its smoothed input minus output."""
        x = self.engine.x
        differences, braking = dict(self.modes.difference), dict(self.modes.braking)
        for sensor in self.model.pulse_sensors:
            fast, slow = sensor.lags_s
            if fast == slow:
                continue
            gain = 1.0 - math.exp(-self._step_s / max(min(fast, slow), 1e-6))
            before = differences[sensor.name]
            smooth = before + gain * (doppler(sensor, x, rate) - x[:, sensor.at] - before)
            differences[sensor.name] = smooth
            braking[sensor.name] = (braking[sensor.name] & (smooth <= self._lag_switch)) | (smooth < -self._lag_switch)
        self.modes = replace(self.modes, difference=differences, braking=braking)

    def _update(self, aid: AidReading, index: int, *, new: bool) -> None:
        if aid.receiver is not None:
            self._follow_fix(aid.receiver, aid.mask)
        z = np.where(aid.mask[:, np.newaxis], aid.z, 0.0)
        found = innovation(self.engine, aid.observation, z, aid.variances)
        if new:
            before = self.nis.get(aid.source, np.full(len(aid.mask), np.nan))
            self.nis[aid.source] = np.where(aid.mask, found.nis, before)
        mask = aid.mask
        if self._gate.enabled:
            passed = found.nis <= self._gate.sigmas**2 + aid.z.shape[1] - 1.0
            again = self._long_refused(aid, index) & ~passed & mask
            if aid.receiver is not None:
                size = np.sqrt(np.square(found.y).mean(axis=1))
                self._renew(aid.receiver, np.maximum(size, aid.receiver.sigma_m), again)
            used = mask & (passed | again)
            self._remember(aid, mask, used, index)
            mask = used
        self.engine.update(aid.observation, z, mask, aid.variances)

    def _follow_fix(self, receiver: Receiving, known: BoolArray) -> None:
        """Change the receiver's correlated error as its fix says: anew in another state, more with age."""
        before = self.modes.position_sigma_m[receiver.model.name]
        states = self.modes.fix_state
        renewed = known & (receiver.state != states[receiver.model.name])
        now = np.where(known, receiver.state, states[receiver.model.name])
        self.modes = replace(self.modes, fix_state={**states, receiver.model.name: now})
        grown = known & ~renewed & (receiver.sigma_m > before)
        if (renewed | grown).any():
            added = np.where(grown, np.square(receiver.sigma_m) - np.square(before), 0.0)
            self._change(receiver, renewed, np.where(renewed, np.square(receiver.sigma_m), added))
        self._keep_sigma(receiver, np.where(known, receiver.sigma_m, before))

    def _renew(self, receiver: Receiving, sigma_m: FloatArray, members: BoolArray) -> None:
        """Draw a receiver's correlated error anew where it is believed again after a jump."""
        if members.any():
            self._change(receiver, members, np.where(members, np.square(sigma_m), 0.0))

    def _change(self, receiver: Receiving, renewed: BoolArray, added_m2: FloatArray) -> None:
        self._note_corrected()
        change = ErrorChange(receiver.model, keep=np.where(renewed, 0.0, 1.0), added_m2=added_m2, size=self.model.size)
        self._predict(change, self._zero, 0.0)

    def _keep_sigma(self, receiver: Receiving, sigma_m: FloatArray) -> None:
        sigmas = {**self.modes.position_sigma_m, receiver.model.name: sigma_m}
        self.modes = replace(self.modes, position_sigma_m=sigmas)

    def _long_refused(self, aid: AidReading, index: int) -> BoolArray:
        """Members in which an aid has been refused for so long that it may be right after all."""
        since = self.modes.refused_since
        limit = self._gate.reacquire_s / self._step_s
        nothing = np.full(len(aid.mask), np.nan)
        long: BoolArray = index - since.get(aid.source, nothing) > limit
        if aid.speed_source:
            for name in self._speed_sources:
                if name != aid.source:  # another speed that is used speaks against this one
                    long = long & ~(index - self.modes.used_at.get(name, nothing) <= limit)
        return long

    def _remember(self, aid: AidReading, known: BoolArray, used: BoolArray, index: int) -> None:
        since = self.modes.refused_since
        before = since.get(aid.source, np.full(len(known), np.nan))
        refused = np.where(np.isnan(before), float(index), before)
        after = np.where(known, np.where(used, np.nan, refused), before)
        used_at = self.modes.used_at
        last = np.where(used, float(index), used_at.get(aid.source, np.full(len(known), -np.inf)))
        self.modes = replace(
            self.modes, refused_since={**since, aid.source: after}, used_at={**used_at, aid.source: last}
        )
