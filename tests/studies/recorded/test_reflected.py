"""Ranges that may be reflected: the update beside the posterior on a grid, and two faults that a hard gate makes."""

import numpy as np
import pytest
from made_up_motion import ANCHORS, LEVER, as_map, made_up, place
from scipy.stats import norm

from ortilo_drake.interop.recorded.map_file import FilterSettings, Start
from ortilo_drake.interop.recorded.range_rows import single_ranges
from ortilo_drake.interop.recorded.recording import Imu
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.studies.recorded.anchor_trust import LENGTH, WILD, share_after, weigh_range
from ortilo_drake.studies.recorded.filter_types import FilterSetup
from ortilo_drake.studies.recorded.filtered import estimate


@pytest.mark.parametrize("share", [0.02, 0.5, 0.95])
@pytest.mark.parametrize("own", [0.01, 0.3, 2.0])
@pytest.mark.parametrize("e", [-3.0, -0.35, -0.05, 0.0, 0.1, 0.45, 0.7, 1.1, 2.0, 30.0])
def test_mean_and_variance_are_those_of_the_posterior_on_a_grid(e, own, share) -> None:
    """The state's part s of an innovation, N(0, own²) a priori, has these moments by Bayes' rule on a fine grid."""
    noise = 0.06
    s = np.linspace(-12.0 * own, 12.0 * own, 200_001)
    parts = np.array(
        [
            (1.0 - share) * norm.pdf(e - s, scale=noise),
            share * norm.cdf((e - s) / noise) / LENGTH,
            np.full(len(s), WILD),
        ]
    ) * norm.pdf(s, scale=own)
    posterior = parts.sum(axis=0) / parts.sum()
    mean = s @ posterior
    variance = (s - mean) ** 2 @ posterior
    weighed_e, weighed_S, reflected = weigh_range(e, own**2 + noise**2, share)
    assert own**2 * weighed_e / weighed_S == pytest.approx(mean, abs=1e-6 * own)
    assert own**2 - own**4 / weighed_S == pytest.approx(variance, rel=1e-5)
    assert reflected == pytest.approx((parts[1].sum() + share * parts[2].sum()) / parts.sum(), abs=1e-6)


def test_a_reflection_is_forgotten() -> None:
    assert share_after(0.01, 0.05, 1.0) == 0.05  # a range may be reflected whatever the last ones were
    assert share_after(0.9, 0.05, np.inf) == 0.05
    assert share_after(0.9, 0.05, 0.5) > share_after(0.9, 0.05, 2.0) > 0.05


def flown(seed, reflected, fault):
    """Errors, standard deviations (m, 3) and stamps of a flight whose ranges (n, 6) [m] have a fault; nan are lost."""
    motion = made_up(20.0, seed, noise=0.05)
    t, r = motion.t_r, motion.r.copy()
    fault(t, r)
    n = r.shape[1]
    stamps, anchors, r = np.repeat(t, n), np.tile(np.arange(n), len(t)), r.ravel()
    heard = np.isfinite(r)
    ranges = single_ranges(stamps[heard], anchors[heard], r[heard])
    imu = Imu(motion.t_imu, motion.imu[:, :3], motion.imu[:, 3:], None)
    start = Start(position=tuple(place(t[:1])[0]), position_sd=0.05, heading=0.5)
    known = FilterSetup(ANCHORS, None, LEVER, 0.5, start=start)
    settings = FilterSettings(range_white=0.05, reflected=reflected)
    found = estimate(ranges, imu, known, settings, np.arange(1.0, 19.9, 1.0 / 30.0))
    return found.p - place(found.t), np.sqrt(np.einsum("kii->ki", found.P)), found.t


def no_fault(t, r):
    pass


def gap(t, r):
    """No range for 2 s, and then one that is reflected, 0.05 s before the others."""
    r[(t > 10.0) & (t < 12.0)] = np.nan
    first = np.flatnonzero(t >= 12.0)[0]
    r[first, [0, 2, 3, 4, 5]] = np.nan
    r[first, 1] += 0.75


def behind_metal(t, r):
    """All but one anchor are right, which errs for 4 s."""
    r[(t > 9.0) & (t < 13.0), 2] += 0.5


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("fault", [gap, behind_metal])
def test_no_reflection_makes_the_filter_believe_a_wrong_place(fault, seed) -> None:
    off, sd, _ = flown(seed, 0.0, fault)
    assert (np.abs(off) / sd).max() > 6.0  # the fault is one, for a hard gate
    off, sd, t = flown(seed, 0.05, fault)
    assert (np.abs(off) / sd).max() < 3.0
    assert np.linalg.norm(off[t > 12.3], axis=1).max() < 0.35


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_without_reflections_it_costs_next_to_nothing(seed) -> None:
    (gated, gated_sd, _), (off, sd, _) = (flown(seed, share, no_fault) for share in (0.0, 0.05))
    assert np.sqrt(np.mean(off**2)) < 1.1 * np.sqrt(np.mean(gated**2))
    assert sd.mean() == pytest.approx(gated_sd.mean(), rel=0.05)


def test_differences_are_refused_whose_sign_tells_no_reflection() -> None:
    text = (
        "differences: {file: f, topic: t, value: d, a: a, b: b}\nanchors: {A: [0, 0, 0], B: [6, 0, 2], C: [6, 8, 0]}\n"
    )
    as_map(text)
    with pytest.raises(InputError, match=r"filter\.reflected: is of single ranges only"):
        as_map(text + "filter: {reflected: 0.05}\n")
