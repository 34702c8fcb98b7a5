"""The command `ortilo hil bridge`: it passes a simulated flight, or real sensors, on to ROS 2 and MAVLink."""

import contextlib
from pathlib import Path
from typing import Annotated

import typer

from ortilo_drake.commands.hil.live_bridge import LiveOptions, run_live_bridge
from ortilo_drake.commands.hil.options import InsecureOption, KeyOption, UrlOption, WaitOption
from ortilo_drake.commands.options import (
    DEFAULT_SCENARIO,
    JsonOption,
    ScenarioArgument,
    SeedOption,
    SetOption,
    finite,
)
from ortilo_drake.commands.terminal import say_written, show_report, write_json
from ortilo_drake.hil.wire.urls import DEFAULT_URL
from ortilo_drake.interop.mavlink import COMPONENT
from ortilo_drake.scenario import InputError, load_scenario


def bridge(
    scenario: ScenarioArgument = DEFAULT_SCENARIO,
    seed: SeedOption = None,
    settings: SetOption = None,
    ros2: Annotated[bool, typer.Option("--ros2", help="Publish to ROS 2, on this machine.")] = False,
    mavlink: Annotated[
        str | None, typer.Option(metavar="udpout:HOST:PORT", help="Send the estimate as MAVLink 2 to this address.")
    ] = None,
    vision: Annotated[
        bool, typer.Option("--vision", help="With --mavlink, send VISION_POSITION_ESTIMATE instead of ODOMETRY.")
    ] = False,
    system: Annotated[
        int, typer.Option(min=1, max=255, help="With --mavlink, the vehicle's system id, MAV_SYS_ID of a PX4.")
    ] = 1,
    component: Annotated[
        int, typer.Option(min=1, max=255, help="With --mavlink, the component id of this bridge.")
    ] = COMPONENT,
    source: Annotated[
        str | None,
        typer.Option(
            "--from",
            metavar="ros2|BAG",
            help="Filter real sensors: live topics of ROS 2, or a bag played at its own pace. Needs --map.",
        ),
    ] = None,
    map_file: Annotated[
        Path | None,
        typer.Option("--map", help="With --from, the MAP.yaml of `ortilo replay`, which says which topic is what."),
    ] = None,
    rate: Annotated[
        float | None,
        typer.Option(
            min=0.1,
            max=1000.0,
            callback=finite,
            show_default="30 with --mavlink, else 10",
            help="With --from, number of estimates per second.",
        ),
    ] = None,
    lag: Annotated[
        float,
        typer.Option(min=0.0, max=10.0, callback=finite, help="With --from, how long to wait for a late topic [s]."),
    ] = 0.1,
    speed: Annotated[
        float, typer.Option(min=0.01, help="With --from BAG, speed of playing: 1 is the bag's own, inf does not wait.")
    ] = 1.0,
    hold: Annotated[
        str | None,
        typer.Option(metavar="x,y,z", help="With --from, compute attitude and thrust that hold this position [m]."),
    ] = None,
    yaw: Annotated[
        float | None,
        typer.Option(
            callback=finite,
            show_default="as estimated when setpoints begin",
            help="With --hold, the yaw to hold, from the anchors' x axis towards y [rad].",
        ),
    ] = None,
    arm: Annotated[
        bool,
        typer.Option("--arm", help="With --hold and --mavlink, send these setpoints to the autopilot. Off by default."),
    ] = False,
    hover_thrust: Annotated[
        float | None,
        typer.Option(min=0.05, max=0.9, help="With --arm, the share of full thrust at which the vehicle hovers."),
    ] = None,
    most_deviation: Annotated[
        float,
        typer.Option(
            min=0.01,
            callback=finite,
            help="With --from and --mavlink, send no estimate with a larger standard deviation of position [m].",
        ),
    ] = 1.0,
    state: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="With --from and --mavlink, save the filter's state in this file, and continue from it after a crash.",
        ),
    ] = None,
    keep: Annotated[
        bool, typer.Option("--keep-alive", help="With --state, restart at once whenever the bridge is killed.")
    ] = False,
    url: UrlOption = DEFAULT_URL,
    key: KeyOption = None,
    insecure: InsecureOption = False,
    wait: WaitOption = 60.0,
    seconds: Annotated[
        float | None, typer.Option(min=0.1, callback=finite, help="End after this real time [s].")
    ] = None,
    json_file: JsonOption = None,
) -> None:
    """Pass the estimate from real sensors, or a simulated flight, on to ROS 2 or a MAVLink autopilot.

    Real sensors, with --from ros2: the topics go through the filter of `ortilo replay`, and its estimate goes out as
    topics, and with --mavlink as ODOMETRY. Setpoints for the autopilot are sent only with --arm, near the place to
    hold, and not while the estimate is too old or too uncertain. See docs/how_to/real_sensors.md.

    A simulated flight, without --from: a world and an onboard half fly it in two other processes. With --ros2 the
    vehicle flies to goals on /goal_pose, in real time: to their x and y, at its present height.
    """
    chosen = load_scenario(scenario, tuple(settings or ()), seed)
    if vision and mavlink is None:
        raise InputError("--vision: needs --mavlink")
    if source is not None:
        options = LiveOptions(
            source, map_file, rate, lag, speed, hold, yaw, arm, hover_thrust, most_deviation, state, keep
        )
        run_live_bridge(options, chosen, mavlink, vision, seconds, json_file, ros2, (system, component))
        return
    for name, value in (
        ("--map", map_file),
        ("--hold", hold),
        ("--yaw", yaw),
        ("--state", state),
        ("--keep-alive", keep or None),
        ("--arm", arm or None),
        ("--hover-thrust", hover_thrust),
    ):
        if value is not None:
            raise InputError(f"{name}: needs --from")
    if not ros2 and mavlink is None:
        raise InputError("--ros2, --mavlink: one of them is needed, or both")
    from ortilo_drake.hil.bridge import Goals, Target, mavlink_target, ros2_target, run_bridge
    from ortilo_drake.hil.wire.key_file import choose_key
    from ortilo_drake.interop.mavlink import MavlinkBridge
    from ortilo_drake.interop.ros.ros2 import Ros2Bridge

    secret = choose_key(url, key, insecure)
    targets: dict[str, Target] = {}
    goals: Goals | None = None
    with contextlib.ExitStack() as stack:
        if mavlink is not None:
            sender = stack.enter_context(contextlib.closing(MavlinkBridge(mavlink, system, component)))
            targets["mavlink"] = mavlink_target(sender, chosen, vision)
        if ros2:
            node = stack.enter_context(Ros2Bridge(chosen))
            targets["ros2"], goals = ros2_target(node), node.goal
        report = run_bridge(url, secret, chosen, targets, seconds, wait, lambda line: print(line, flush=True), goals)
    write_json(json_file, report.lines())
    show_report(report.lines())
    say_written(json_file)
