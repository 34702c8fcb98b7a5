"""The servo's and the filter's Riccati equations of a scenario by all four solvers."""

from dataclasses import dataclass

import numpy as np

from ortilo_drake.model.signals import XBAR_NAMES
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.servo.lq_gain import augmented_pair, weight_matrices
from ortilo_drake.scenario import LqServo, Scenario
from ortilo_drake.studies.loop.hover_loop import arrived_rows, filter_V, hover_loop, sensor_subsets
from ortilo_drake.theory.riccati.riccati import RAW, solve
from ortilo_drake.theory.riccati.riccati_check import RiccatiCheck, assess
from ortilo_drake.theory.riccati.riccati_ill_posed import ILL_POSED, SolverOutcomes, solver_outcomes
from ortilo_drake.theory.riccati.riccati_problem import require_well_posed

DRAKE_LIFT = 1e-10  # multiple of I added to W for Drake, which wants it positive definite

Dare = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Unsolved:
    """A solver's failure on a well-posed equation."""

    note: str


@dataclass(frozen=True)
class Solution(RiccatiCheck):
    """A solver's X: its quality, its relative Frobenius distance from the others' X, and how it was solved."""

    difference: dict[str, float]
    note: str | None


Solutions = dict[str, Solution | Unsolved]  # by solver


@dataclass(frozen=True)
class IllPosed:
    """An equation without a solution, and why."""

    error: str


@dataclass(frozen=True)
class RiccatiReport:
    """Solutions of the servo's equation and of the filter's, by subset of sensors, and solvers on ill-posed problems.

    A registered servo has no equation, so its solutions are empty.
    """

    servo: Solutions
    filter: dict[str, Solutions | IllPosed]
    ill_posed: dict[str, SolverOutcomes]


def servo_dare(scenario: Scenario) -> Dare:
    """Return Phibar, Gammabar, Qbar, R of the servo's equation (15 states)."""
    return (*augmented_pair(scenario.vehicle, scenario.h, scenario.yaw), *weight_matrices(scenario.servo.weights))


def filter_dare(scenario: Scenario, sensors: tuple[str, ...], V: np.ndarray) -> Dare:
    """Return Phi^T, C^T, W, V of the filter's equation (12 states, or all of the filter's) with some of the sensors.

    These sensors arrive in every tick; V is the covariance of all measurements (p x p). InputError as arrived_rows.
    """
    loop = hover_loop(scenario)
    rows, V = arrived_rows(sensors, filter_V(scenario, V), loop.measurement)
    return loop.Phi.T, loop.C[rows].T, loop.W, V


def four_solutions(dare: Dare, names: tuple[str, ...], dual: bool) -> Solutions:
    """Return the quality of each solver's X.

    Drake may refuse a W that is only semidefinite. For Drake alone DRAKE_LIFT I is then added; the note says so, or
    that Drake refuses this too. The residual is that of the equation as posed, so it shows the effect. InputError
    naming the modes, if the equation is ill-posed.
    """
    A, B, Q, R = dare
    require_well_posed(A, B, Q, R, names=names, dual=dual)
    solutions, notes = {}, {}
    for solver in RAW:
        try:
            solutions[solver] = solve(A, B, Q, R, solver=solver, names=names, dual=dual)
        except InputError as error:
            notes[solver] = str(error)
    if "drake" in notes:
        lifted = f"with {DRAKE_LIFT:g} I added to the weight of the states"
        try:
            solutions["drake"] = solve(A, B, Q + DRAKE_LIFT * np.eye(len(Q)), R, solver="drake", names=names, dual=dual)
            notes["drake"] = f"Drake refuses the equation; solved {lifted}"
        except InputError:
            notes["drake"] = f"Drake refuses the equation also {lifted}"
    rows: Solutions = {}
    for solver in RAW:
        if solver not in solutions:
            rows[solver] = Unsolved(notes[solver])
            continue
        X = solutions[solver]
        others = {other: Y for other, Y in solutions.items() if other != solver}
        distances = {other: float(np.linalg.norm(X - Y) / np.linalg.norm(Y)) for other, Y in others.items()}
        rows[solver] = Solution(**vars(assess(A, B, Q, R, X)), difference=distances, note=notes.get(solver))
    return rows


def servo_and_filter_dares(scenario: Scenario, sensors: tuple[str, ...], V: np.ndarray) -> dict[str, Solutions]:
    """Return four_solutions of the 'servo' and the 'filter'; arguments and errors as in filter_dare."""
    return {
        "servo": four_solutions(servo_dare(scenario), XBAR_NAMES, dual=False),
        "filter": four_solutions(filter_dare(scenario, sensors, V), hover_loop(scenario).names, dual=True),
    }


def riccati_report(scenario: Scenario, V: np.ndarray) -> RiccatiReport:
    """Return the solutions of the servo's and each sensor subset's filter equation, and the ill-posed cases.

    V is the covariance of all measurements (p x p), positive definite.
    """
    filters: dict[str, Solutions | IllPosed] = {}
    names, weighs = hover_loop(scenario).names, isinstance(scenario.servo, LqServo)
    for name, sensors in reversed(sensor_subsets(scenario.sensors).items()):
        if not sensors:
            continue
        try:
            filters[name] = four_solutions(filter_dare(scenario, sensors, V), names, dual=True)
        except InputError as error:
            if not str(error).startswith("Riccati equation"):
                raise
            filters[name] = IllPosed(str(error))
    return RiccatiReport(
        servo=four_solutions(servo_dare(scenario), XBAR_NAMES, dual=False) if weighs else {},
        filter=filters,
        ill_posed={case: solver_outcomes(*matrices) for case, matrices in ILL_POSED.items()},
    )
