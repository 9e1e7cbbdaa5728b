"""How wrong a GNSS receiver is, and how wrong it says it is, in each of its fix states.

    error = share x dilution x sigma_s x z_s  +  age x drift_s x g  +  dilution x white_s x n

``z_s`` (one per state) and ``g`` are independent first-order Gauss-Markov processes of variance one, ``n`` is white.

- Each state has an error process of its own that goes on while the receiver is in other states. So the step at a
  transition is the difference of two states' errors, and a receiver that comes back after a moment finds almost the
  error it left; after many correlation times a new one. Exact: over m samples z becomes
  e^{-mT/tau} z + sqrt(1 - e^{-2mT/tau}) n, whatever m is, so only the present state's process costs anything.
- ``share``: a float solution that was fixed a moment ago is better than one that has been floating for long, and it
  improves before it is fixed. On F9P data the error in float is 0.43 m rms (three axes), but the steps fixed -> float
  and float -> fixed have medians of only 0.16 and 0.13 m, where draws from the stationary float error would give 0.36.
  The share begins at ``entry_ratio``, grows to one, and shrinks to ``entry_ratio`` while a better state is acquired.
- ``age x drift x g``: its standard deviation is exactly drift x age at every age; it is continuous as age grows, and
  falls back, a step, when new corrections arrive. Measured heights move this way, not as noise.
- ``dilution``: fewer satellites (:func:`twin.sensors.gnss_states.dilution`); velocities suffer from it alike.

What the receiver reports depends on its state, age and dilution alone, never on its true error.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin.fix_quality import WITH_CORRECTIONS
from twin.sensors.gnss_kernels import DRIFT, position_errors, receiver_reports
from twin.sensors.gnss_states import FixState
from twin.sensors.noise import Streams, decay
from twin.signals import FloatArray, IntArray


class PositionErrors:
    """True position errors of R receivers, each in one of its states."""

    def __init__(
        self, states: Sequence[FixState], index: IntArray, *, drift_s: float, period_s: float, streams: Streams
    ) -> None:
        runs, count = len(index), len(states)
        self._sigma = np.array([state.correlated_sigma_m for state in states])
        self._white_sigma = np.array([state.white_sigma_m for state in states])
        tau = np.array([state.correlation_s for state in states])
        self._decay_rate = np.divide(period_s, tau, out=np.full_like(tau, np.inf), where=tau > 0.0)
        self._keep = np.array([decay(state.correlation_s, period_s) for state in states])
        self._entry = np.array([state.entry_ratio for state in states])
        self._growth_keep = decay([state.growth_s for state in states], period_s)
        self._settling_keep = decay([state.settling_s for state in states], period_s)
        self._age_drift = np.array([state.age_drift_m_s for state in states])
        self._unit = streams.once("position_correlated_start", 3 * count).reshape(runs, count, 3)
        self._unit_step = np.zeros((runs, count), dtype=np.int64)
        self._last = index.copy()
        self._share = np.ones(runs)
        self._drift = streams.once("age_drift_start", 3)
        self._drift_keep = float(decay(drift_s, period_s)[0])
        self._step = 0
        self.normals_needed = DRIFT + 3 if self._age_drift.any() else DRIFT
        """How many normal numbers a sample takes, those of the velocity among them."""
        self.correlated: FloatArray = np.zeros((runs, 3))
        """(R, 3) time-correlated part now; changes in place."""
        self._error = np.zeros((runs, 3))

    def step(
        self,
        t_ns: int,
        *,
        reference_ns: IntArray,
        index: IntArray,
        allowed: IntArray,
        dilution: FloatArray,
        normals: FloatArray,
    ) -> FloatArray:
        """Advance by one sample and return the error, (R, 3), which changes in place at the next call.

        ``index`` (R,) is the state, ``allowed`` (R,) the best one whose conditions hold and which is being acquired.
        ``normals`` (R, ``normals_needed``) are this sample's, as :func:`gnss_kernels.position_errors` wants them.
        """
        self._step += 1
        position_errors(
            self._step,
            t_ns,
            reference_ns,
            index,
            allowed,
            self._sigma,
            self._white_sigma,
            self._decay_rate,
            self._keep,
            self._entry,
            self._growth_keep,
            self._settling_keep,
            self._age_drift,
            dilution,
            self._unit,
            self._unit_step,
            self._last,
            self._share,
            self._drift,
            self._drift_keep,
            normals,
            self.correlated,
            self._error,
        )
        return self._error


class Reports:
    """What a receiver says of itself, by state. ``columns`` stand in its output in this order."""

    columns = ("sigma_e_m", "sigma_n_m", "sigma_u_m", "quality", "satellites", "hdop", "vdop", "age_s")

    def __init__(self, states: Sequence[FixState], *, first: int) -> None:
        self._first = first
        self._sigma = np.array([state.reported_sigma_m for state in states])
        self._age_drift = np.array([state.reported_age_drift_m_s for state in states])
        self._numbers = np.array(
            [[s.quality, s.satellites, s.hdop, s.vdop, s.quality in WITH_CORRECTIONS] for s in states], dtype=np.float64
        )

    def write(
        self,
        values: FloatArray,
        t_ns: int,
        *,
        reference_ns: IntArray,
        index: IntArray,
        satellites: int,
        dilution: FloatArray,
    ) -> None:
        """Write into ``values`` (R, n), from column ``first`` on; all of it is NaN but for quality 0 and satellites
        where there is no position."""
        receiver_reports(
            t_ns,
            reference_ns,
            index,
            satellites,
            self._sigma,
            self._age_drift,
            self._numbers,
            dilution,
            self._first,
            values,
        )
