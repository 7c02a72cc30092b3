"""How strongly an effect shows: its signal-to-noise ratio, where it acts, and what could pass for it.

SNR^2 is what no nuisance can absorb of the difference that the effect makes to a noise-free recording, weighed by the
noise's spectrum (Whittle's likelihood), so it is the expected score of the best possible test of a known effect.
Nuisances of the voltage carry the lab's accuracy as priors: start charge 1 % of each flight, resistance 3 %, capacity
1.5 %, rested voltage 4 mV per cell at seven knots. Those of the power: the vehicle's own level, free.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.concealed.load import Flags
from sim.concealed.packs import GRID, SERIES, Array, Pack

_KNOTS = np.linspace(0.1, 1.0, 7)


@dataclass(frozen=True, slots=True)
class Shown:
    """One flight's difference (S,) and what the nuisances need, once a second."""

    difference: Array
    spectrum: Array  # of the noise, at the frequencies of rfft
    soc: Array
    current_a: Array


def _whitened(columns: Array, spectrum: Array) -> Array:
    """Real columns (S, C) to whitened ones of equal weight (about S, C)."""
    samples = len(columns)
    scale: Array = np.sqrt(spectrum * float(samples))
    turned = np.fft.rfft(columns, axis=0) / scale[:, None]
    twice = np.full(len(turned), 2.0**0.5)
    twice[0] = 1.0
    if samples % 2 == 0:
        twice[-1] = 1.0
    turned = turned * twice[:, None]
    return np.concatenate([turned.real, turned.imag])


def _hats(soc: Array) -> Array:
    width = float(_KNOTS[1] - _KNOTS[0])
    return np.clip(1.0 - np.abs(soc[:, None] - _KNOTS[None, :]) / width, 0.0, None)


def _slope(pack: Pack, soc: Array) -> Array:
    slope: Array = SERIES * np.interp(soc, GRID, np.gradient(pack.ocv_v, GRID))
    return slope


def _nuisances(pack: Pack, shown: list[Shown]) -> list[Array]:
    """Columns of each flight, each one prior standard deviation strong."""
    ohm = float(pack.ohmic.sum() + 0.0257 * (1.0 / pack.exchange_a).sum())
    out = []
    for index, flight in enumerate(shown):
        slope = _slope(pack, flight.soc)
        used = flight.soc[0] - flight.soc
        start = np.zeros((len(slope), len(shown)))
        start[:, index] = 0.01 * slope
        shared = np.column_stack([0.03 * ohm * flight.current_a, 0.015 * used * slope])
        out.append(np.column_stack([start, shared, 0.004 * SERIES * _hats(flight.soc)]))
    return out


def _left(signal: Array, known: Array, free: Array | None) -> float:
    """What is left of a whitened signal after nuisances with unit priors and free ones."""
    columns = known if free is None else np.column_stack([known, free])
    prior = np.where(np.arange(columns.shape[1]) < known.shape[1], 1.0, 1e-9)
    normal = columns.T @ columns + np.diag(prior)
    best = np.linalg.solve(normal, columns.T @ signal)
    squared = float(signal @ signal) - float(best @ (columns.T @ signal))
    return float(np.sqrt(max(squared, 0.0)))


def voltage_snr(pack: Pack, shown: list[Shown]) -> tuple[float, tuple[str, ...]]:
    """SNR of a difference of voltages, and the names of simple effects that could pass for it to within 3."""
    nuisances = _nuisances(pack, shown)
    weighed = [_whitened(n, f.spectrum) for n, f in zip(nuisances, shown, strict=True)]
    signal = np.concatenate([_whitened(f.difference[:, None], f.spectrum)[:, 0] for f in shown])
    known = np.concatenate(weighed)
    snr = _left(signal, known, None)
    passing: list[str] = []
    if snr > 3.0:
        for names, columns in _mimics(pack, shown).items():
            free = np.concatenate([_whitened(c, f.spectrum) for c, f in zip(columns, shown, strict=True)])
            if _left(signal, known, free / np.maximum(np.linalg.norm(free, axis=0), 1e-12)) < 3.0:
                passing += names
    return snr, tuple(passing)


def _mimics(pack: Pack, shown: list[Shown]) -> dict[tuple[str, ...], list[Array]]:
    slopes = [_slope(pack, f.soc) for f in shown]
    starts = []
    for index, slope in enumerate(slopes):
        column = np.zeros((len(slope), len(shown)))
        column[:, index] = slope
        starts.append(column)
    return {
        ("voltage-offset", "voltage-gain"): [np.ones((len(s), 1)) for s in slopes],
        ("contact-resistance", "resistance-growth"): [f.current_a[:, None] for f in shown],
        ("capacity-fade",): [((f.soc[0] - f.soc) * s)[:, None] for f, s in zip(shown, slopes, strict=True)],
        ("unseen-load", "current-offset"): [(np.arange(len(s)) * s)[:, None] for s in slopes],
        ("partial-charge",): starts,
    }


def power_snr(differences: list[Array], levels: list[Array], noise_w: float) -> float:
    """SNR of a difference of powers [W] against gusts, the vehicle's own level being free."""
    keep = np.exp(-1.0 / 2.0)  # gusts and control are forgotten in about two seconds
    signals, free = [], []
    for difference, level in zip(differences, levels, strict=True):
        turn = np.exp(-2j * np.pi * np.fft.rfftfreq(len(difference)))
        spectrum = noise_w**2 * (1.0 - keep**2) / np.abs(1.0 - keep * turn) ** 2
        signals.append(_whitened(difference[:, None], spectrum)[:, 0])
        free.append(_whitened(level[:, None], spectrum))
    column = np.concatenate(free)
    return _left(np.concatenate(signals), np.zeros((len(column), 1)), column / np.linalg.norm(column))


def ranges(strong: Flags, gap_s: int = 15, least_s: int = 3) -> list[tuple[float, float]]:
    """Stretches [s] where a once-a-second flag stands, short gaps closed."""
    out: list[tuple[float, float]] = []
    start = last = None
    for k in np.flatnonzero(strong).tolist():
        if start is None or last is None:
            start = k
        elif k - last > gap_s:
            if last - start >= least_s:
                out.append((float(start), float(last)))
            start = k
        last = k
    if start is not None and last is not None and last - start >= least_s:
        out.append((float(start), float(last)))
    return out
