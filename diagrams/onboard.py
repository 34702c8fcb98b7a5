"""The onboard half: an estimator, a servo and a planner, each exchangeable.

    estimator(scenario, xbar_0)       -> System with the sensors' messages as inputs, named as the world's outputs, and
                                         control (4) and reference (9) if it wants them; outputs estimate (12, or 15
                                         with the integral of the position error) and covariance (its square), and
                                         force (3), the disturbance force in W [N], if it knows it
    servo(scenario)                   -> System with inputs estimate (15), reference (9); output control (4)
    planner(scenario)                 -> the path as a Trajectory p_WB(t) (3 rows) [m], or a System with output
                                         reference (9)

Each may also have as inputs what the others give (estimate, covariance, both as belief (240), control, reference, and
force, 0 where no estimator knows it) and any message. Such a function may be given to make_closed_loop, or registered
and named in the scenario by its kind. The System may be a LeafSystem or a Diagram; it sees nothing of the world but
messages, and of the scenario nothing but the Belief, which leaves out what only the world knows (scenario/belief.py).
"""

from pydrake.trajectories import Trajectory

from ortilo_drake.diagrams.estimator import OfBelief
from ortilo_drake.diagrams.wiring.messages import heard_boxes
from ortilo_drake.diagrams.wiring.onboard import NO_PARTS, Parts, onboard_boxes
from ortilo_drake.onboard.planner.planned import planned, start_of
from ortilo_drake.scenario import Belief

__all__ = ["NO_PARTS", "Onboard", "Parts", "make_onboard"]


class Onboard(OfBelief):
    """The onboard half as a Diagram, made of the wiring of diagrams/wiring/onboard.py.

    Ports:
        uwb, detections, imu, ...: messages of the sensors that the scenario flies.
        image (ImageRgba8U), shutter: the picture of a rendered camera and its message, in place of detections.
        velocity: the true velocities, only where the scenario lends them to the servo.
        acted: which commands acted, only where the scenario's commands want it; see onboard/commands.
        path (object): the path to fly, see onboard/planner/players.py; only if takes_paths.
        control (4, output): u_k, f_T absolute.
        estimate (15, output): xhat_{k|k-1}.
        covariance (225, output): P_k row by row.
        y (p), delta (s), V2 (q) (outputs): the measurement as it reaches the filter in this tick, late ones included;
            of an estimator of one's own that does not tell, nothing arrived.
        reference (9, output): r, r_dot, r_ddot.
        logged (output): all that is logged of it, in the order of measurement.logged_sizes().

    Args:
        scenario: the scenario, of which the belief is all that is taken.
        trajectory: the path to fly (3 rows, W); by default what the scenario's planner plans.
        detects: whether the pictures of a rendered camera come here; if not, detections do.
        parts: in place of the scenario's.
        takes_paths: whether the path is an input, for a half that is given others in flight; not of a planner that
            is a System.
        fused: whether all elements are one system, which is faster, or a system each.

    Attributes:
        r_0: p_WB (3) [m] where the reference starts.

    Raises:
        InputError: if there is no path or no servo gain, if the detector's files are wrong, or if a part of one's own
            has not the ports that it needs.
    """

    def __init__(
        self,
        scenario: Belief,
        trajectory: Trajectory | None = None,
        detects: bool = True,
        parts: Parts = NO_PARTS,
        takes_paths: bool = False,
        fused: bool = False,
    ):
        super().__init__()
        belief = scenario.belief
        plan, room = trajectory or planned(belief, parts.planner), belief.load_room()
        self.r_0 = start_of(plan)
        heard, messages = heard_boxes(belief, room, detects)
        ticks = int(plan.end_time() * belief.control_rate) + 2 if isinstance(plan, Trajectory) else 0
        boxes = onboard_boxes(belief, room, plan, ticks, messages, parts, takes_paths)
        self._assemble("onboard", belief, heard, boxes, fused)


make_onboard = Onboard
