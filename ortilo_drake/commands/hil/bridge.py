"""The command `ortilo hil bridge`: a flight passed on to ROS 2 and MAVLink."""

import contextlib
from typing import Annotated

import typer

from ortilo_drake.commands.hil.options import InsecureOption, KeyOption, UrlOption, WaitOption
from ortilo_drake.commands.options import (
    DEFAULT_SCENARIO,
    JsonOption,
    ScenarioArgument,
    SeedOption,
    SetOption,
    finite,
    quiet_drake,
)
from ortilo_drake.commands.terminal import check_writable, say_written, show_report, write_json
from ortilo_drake.hil.wire.urls import DEFAULT_URL
from ortilo_drake.scenario import InputError, load_scenario


def bridge(
    scenario: ScenarioArgument = DEFAULT_SCENARIO,
    seed: SeedOption = None,
    settings: SetOption = None,
    ros2: Annotated[bool, typer.Option("--ros2", help="Publish as a ROS 2 node, on this machine.")] = False,
    mavlink: Annotated[
        str | None, typer.Option(metavar="udpout:HOST:PORT", help="Send the estimate as MAVLink 2 there.")
    ] = None,
    vision: Annotated[
        bool, typer.Option("--vision", help="With --mavlink, send VISION_POSITION_ESTIMATE in place of ODOMETRY.")
    ] = False,
    url: UrlOption = DEFAULT_URL,
    key: KeyOption = None,
    insecure: InsecureOption = False,
    wait: WaitOption = 60.0,
    seconds: Annotated[float | None, typer.Option(min=0.1, callback=finite, help="End after that long [s].")] = None,
    json_file: JsonOption = None,
) -> None:
    """Listen to a flight of a world and an onboard half, and pass it on to ROS 2 or a MAVLink autopilot.

    With --ros2 a goal on /goal_pose is flown to, in real time: its x and y, at the height that is flown.
    """
    chosen = load_scenario(scenario, tuple(settings or ()), seed)
    if not ros2 and mavlink is None:
        raise InputError("--ros2, --mavlink: give one of them or both")
    if vision and mavlink is None:
        raise InputError("--vision: is how the estimate is sent to --mavlink, which is not given")
    check_writable(json_file)
    from ortilo_drake.hil.bridge import Goals, Target, mavlink_target, ros2_target, run_bridge
    from ortilo_drake.hil.wire.key_file import choose_key
    from ortilo_drake.interop.mavlink import MavlinkBridge
    from ortilo_drake.interop.ros.ros2 import Ros2Bridge

    quiet_drake()
    secret = choose_key(url, key, insecure)
    targets: dict[str, Target] = {}
    goals: Goals | None = None
    with contextlib.ExitStack() as stack:
        if mavlink is not None:
            sender = stack.enter_context(contextlib.closing(MavlinkBridge(mavlink)))
            targets["mavlink"] = mavlink_target(sender, chosen, vision)
        if ros2:
            node = stack.enter_context(Ros2Bridge(chosen))
            targets["ros2"], goals = ros2_target(node), node.goal
        report = run_bridge(url, secret, chosen, targets, seconds, wait, lambda line: print(line, flush=True), goals)
    write_json(json_file, report.lines())
    show_report(report.lines())
    say_written(json_file)
