"""`ortilo hil bridge --from`: real sensors, or a recorded bag, through the filter of `ortilo replay`."""

import contextlib
import math
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from ortilo_drake.commands.hil.going_on import interrupt_once, kept_in
from ortilo_drake.commands.terminal import check_writable, say_if_compiling, say_written, show_report, write_json
from ortilo_drake.model.as_data import as_data
from ortilo_drake.model.inputs.numbers import not_radians
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario

ROS2 = "ros2"
LEAST = 30.0  # rate of estimates that PX4 needs [Hz]; PX4 needs no more than 50


@dataclass(frozen=True)
class LiveOptions:
    """The options that go with `--from`.

    Attributes:
        source: 'ros2', or the path of a bag.
        map_file: MAP.yaml, which says which topic is what.
        rate: rate of the estimates [Hz]; by default LEAST with MAVLink, else the default of replay.
        lag: longest time for which a silent topic delays the others [s].
        speed: playing speed of a bag over its recorded speed; inf plays without waiting.
        hold: position to hold, 'x,y,z' [m].
        yaw: yaw to hold [rad]; None holds the yaw that is estimated when setpoints begin.
        arm: whether setpoints are sent to the autopilot.
        hover_thrust: share of the largest thrust at which the vehicle hovers.
        most_deviation: largest standard deviation of the position with which an estimate is sent by MAVLink [m].
        state_file: file in which the filter's state is saved, and from which a new bridge continues; None for none.
        keep: whether a killed bridge is restarted at once.
    """

    source: str
    map_file: Path | None
    rate: float | None
    lag: float
    speed: float
    hold: str | None
    yaw: float | None
    arm: bool
    hover_thrust: float | None
    most_deviation: float
    state_file: Path | None = None
    keep: bool = False


def check_live(options: LiveOptions, mavlink: str | None, ros2: bool) -> tuple[float, ...] | None:
    """Return the position to hold (3) [m]; None if there is none.

    Raises:
        InputError: if an option is missing, or contradicts another.
    """
    if options.map_file is None:
        raise InputError("--map: is missing: MAP.yaml says which topic is what (docs/how_to/recorded.md)")
    if options.arm and (options.hold is None or mavlink is None or options.hover_thrust is None):
        raise InputError(
            "--arm: needs --mavlink, --hold x,y,z and --hover-thrust, the share of full thrust that hovers"
        )
    if options.keep and options.state_file is None:
        raise InputError("--keep-alive: needs --state FILE, from which the next process continues")
    if options.state_file is not None:
        if mavlink is None:
            raise InputError("--state: needs --mavlink")
        check_writable(options.state_file)
    if ros2 and options.source != ROS2:
        raise InputError(
            "--ros2: cannot publish a bag's estimates: play the bag with `ros2 bag play`, and give --from ros2"
        )
    if options.yaw is not None and (wrong := not_radians(options.yaw)):
        raise InputError(f"--yaw: {wrong}")
    if options.hold is None:
        if options.yaw is not None:
            raise InputError("--yaw: needs --hold")
        return None
    try:
        place = tuple(float(part) for part in options.hold.split(","))
    except ValueError:
        place = ()
    if len(place) != 3 or not all(map(math.isfinite, place)):
        raise InputError(f"--hold: {options.hold!r}: must be three numbers, x,y,z in the anchors' frame [m]")
    return place


def run_live_bridge(
    options: LiveOptions,
    scenario: Scenario,
    mavlink: str | None,
    vision: bool,
    seconds: float | None,
    json_file: Path | None,
    ros2: bool,
    ids: tuple[int, int],
) -> None:
    """Run the bridge until its source ends, the time is over, or Ctrl-C; then print its report.

    `ids` are the system and component id of its MAVLink messages.
    """
    place = check_live(options, mavlink, ros2)
    run = partial(_run, options, place, scenario, mavlink, vision, seconds, json_file, ids)
    if not options.keep:
        run(0)
        return
    from ortilo_drake.hil.restart.keep_alive import keep_alive
    from ortilo_drake.interop.recorded.map_file import load_map
    from ortilo_drake.studies.live.live_bridge import LiveBridge

    assert options.map_file is not None
    say_if_compiling()
    LiveBridge(load_map(options.map_file), _say).warm_up()
    _warm_up_outputs()
    if options.source == ROS2:
        with contextlib.suppress(ImportError):  # the first process reports it
            import_module("rclpy")
    with contextlib.suppress(KeyboardInterrupt):  # the bridge has already printed its report
        keep_alive(run, _say, "bridge")


def _run(
    options: LiveOptions,
    place: tuple[float, ...] | None,
    scenario: Scenario,
    mavlink: str | None,
    vision: bool,
    seconds: float | None,
    json_file: Path | None,
    ids: tuple[int, int],
    killed: int,
) -> None:
    """Run a bridge; if `killed` bridges ran before, the vehicle is no longer at its start."""
    from ortilo_drake.interop.mavlink import CRITICAL, NOTICE, WARNING, MavlinkBridge
    from ortilo_drake.interop.recorded.map_file import load_map
    from ortilo_drake.studies.live.live_bridge import LiveBridge, run_live
    from ortilo_drake.studies.live.live_filter import RATE
    from ortilo_drake.studies.live.setpoints import Holding
    from ortilo_drake.studies.live.stamped_estimate import MOST_YAW, Limits

    assert options.map_file is not None
    map_ = load_map(options.map_file)
    if killed:
        map_ = map_.in_the_air()
    if options.keep:
        signal.signal(signal.SIGINT, interrupt_once)
    holding = None if place is None else Holding(scenario, place, options.yaw)
    with contextlib.ExitStack() as stack:
        sender = None if mavlink is None else stack.enter_context(contextlib.closing(MavlinkBridge(mavlink, *ids)))

        def say(line: str, severity: int = WARNING) -> None:
            _say(line)
            if sender is not None:
                sender.send_text(line, severity)

        rate = options.rate or (RATE if mavlink is None else LEAST)
        if mavlink is not None and rate < LEAST:
            _say(f"warning  --rate: {rate:g} Hz: PX4 needs {LEAST:g} to 50 Hz, and may ignore slower estimates")
        pace = 1.0 if options.source == ROS2 else options.speed
        # A bag that is played without waiting has no wall clock: the age of an estimate follows from its stamps.
        wall = (lambda: 0.0) if math.isinf(pace) else (lambda: pace * time.monotonic())
        bridge = LiveBridge(map_, say, rate, options.lag, holding, partial(say, severity=NOTICE), wall)
        if map_.truth is not None:
            _say("truth: is not used live: nothing is calibrated by it")
        if sender is not None:
            # An autopilot fuses an estimate at the estimate's stamp, at most a fraction of a second back.
            limits, send = Limits(options.most_deviation, MOST_YAW), _to_mavlink(sender, vision, options)
            if options.state_file is not None:
                send = kept_in(options.state_file, map_, bridge, send, say)
            bridge.add_target("mavlink", send, scenario.failsafe.timeout, limits)
        if not options.keep:
            say_if_compiling()
            bridge.warm_up()
            _warm_up_outputs()
        if options.source == ROS2:
            from ortilo_drake.interop.ros.ros2_live import Ros2Live

            node = stack.enter_context(Ros2Live(bridge.topics, _say))
            bridge.add_target("ros2", _to_ros2(node))
            _say(f"waiting for {', '.join(bridge.topics)}")
            messages: Iterator[tuple[str, int, Any] | None] = node.messages()
            if sender is not None:
                from ortilo_drake.interop.mavlink_timesync import TimesyncThread

                answers = stack.enter_context(TimesyncThread(sender, say))
                messages = _checked(messages, bridge, answers.check_stamp)
        else:
            from ortilo_drake.interop.recorded.bag_columns import at_pace, bag_messages

            played = bag_messages(Path(options.source), bridge.topics)
            messages = played if math.isinf(options.speed) else at_pace(played, options.speed)
            if sender is not None:
                messages = _beating(messages, sender)
        if mavlink is not None:
            _say(_armed(options, scenario, mavlink))
        try:
            report = run_live(bridge, messages, say, seconds)
        except InputError as error:
            if sender is not None:
                sender.send_text(f"the bridge has ended: {error}", CRITICAL)
            raise
    write_json(json_file, report)
    show_report({name: value for name, value in as_data(report).items() if name != "anchors" and _applies(value)})
    for name, one in report.anchors.items():
        _say(f"  {f'anchor {name}':20}{one.text()}")
    say_written(json_file)


def _checked(messages: Iterator[Any], bridge: Any, check_stamp: Callable[[float], None]) -> Iterator[Any]:
    """Yield messages; after the bridge took each one, check the newest stamp."""
    for message in messages:
        yield message
        if message is not None:
            check_stamp(bridge.newest)


def _beating(messages: Iterator[Any], sender: Any) -> Iterator[Any]:
    """Yield a bag's messages, and send a heartbeat each second of the bag; live, TimesyncThread sends heartbeats."""
    beat = -math.inf
    for message in messages:
        if message[1] >= beat:
            sender.send_heartbeat()
            beat = message[1] + 1e9
        yield message


def _applies(value: Any) -> bool:
    """Return whether a row of the report is printed: a row without a value, or with an empty list, is not."""
    return value is not None and value not in ("", {})


def _say(line: str) -> None:
    print(line, flush=True)


def _warm_up_outputs() -> None:
    """Compile the functions that make messages of an estimate, so that the first estimate does not wait for seconds."""
    import numpy as np

    from ortilo_drake.interop.mavlink import odometry_fields
    from ortilo_drake.interop.ros.ros_motion import estimate_messages, setpoint_messages, tf_message
    from ortilo_drake.model.signals import N_XBAR

    x, P = np.zeros(N_XBAR), np.eye(N_XBAR)
    odometry_fields(0.0, x, P)
    estimate_messages(0.0, x, P.ravel())
    tf_message(0.0, x)
    setpoint_messages(0.0, np.zeros(3), 0.0)


def _armed(options: LiveOptions, scenario: Scenario, mavlink: str) -> str:
    """Return a line that says whether and when setpoints are sent."""
    from ortilo_drake.studies.live.setpoints import NEAR

    if not options.arm:
        return f"{mavlink}: sends only the estimate; setpoints are off (--arm sends them)"
    return (
        f"{mavlink}: ARMED: attitude and thrust are sent to hold {options.hold} from within {NEAR:g} m of it, but not "
        f"while the estimate is older than {scenario.failsafe.timeout:g} s or too uncertain: then the autopilot's own "
        "failsafe flies"
    )


def _to_mavlink(sender: Any, vision: bool, options: LiveOptions) -> Callable[..., None]:
    """Return a target that sends every estimate by MAVLink, and every setpoint if armed."""
    from ortilo_drake.model.vehicle import GRAVITY

    first = math.nan
    send_estimate = sender.send_vision if vision else sender.send

    def send(stamped: Any, wanted: Any, lost: int) -> None:
        nonlocal first
        first = stamped.t if math.isnan(first) else first
        send_estimate(stamped.t, stamped.estimate, stamped.covariance, lost)
        if options.arm and wanted is not None and not wanted.refused:
            assert options.hover_thrust is not None
            sender.send_attitude(stamped.t - first, wanted.rpy, options.hover_thrust * wanted.thrust / GRAVITY)

    return send


def _to_ros2(node: Any) -> Callable[..., None]:
    """Return a target that publishes every estimate and setpoint to ROS 2."""

    def send(stamped: Any, wanted: Any, lost: int) -> None:
        node.send_estimate(stamped.t, stamped.estimate, stamped.covariance)
        if wanted is not None and not wanted.refused:
            node.send_setpoint(stamped.t, wanted.rpy, wanted.thrust)

    return send
