"""The command `ortilo hil goal`: it sends another goal to a flight under way."""

from typing import Annotated

import typer

from ortilo_drake.commands.hil.options import InsecureOption, KeyOption, UrlOption
from ortilo_drake.commands.options import DEFAULT_SCENARIO, ScenarioArgument, SeedOption, SetOption, finite
from ortilo_drake.commands.terminal import out
from ortilo_drake.hil.wire.urls import DEFAULT_URL
from ortilo_drake.scenario import load_scenario


def goal(
    x: Annotated[float, typer.Argument(callback=finite, help="East [m].")],
    y: Annotated[float, typer.Argument(callback=finite, help="North [m].")],
    scenario: ScenarioArgument = DEFAULT_SCENARIO,
    seed: SeedOption = None,
    settings: SetOption = None,
    url: UrlOption = DEFAULT_URL,
    key: KeyOption = None,
    insecure: InsecureOption = False,
    wait: Annotated[
        float, typer.Option(min=0.1, callback=finite, help="Time to wait for the world, and then for an answer [s].")
    ] = 5.0,
) -> None:
    """Send a new goal to a vehicle that flies in real time: it brakes, plans a path from where it stops, and flies it.

    The vehicle keeps the height at which it stops, and the servo's yaw. A newer goal replaces an older goal. A goal
    that no free path reaches is refused in one line. The flight ends when it would have ended without the goal: see
    --seconds of `ortilo hil world`.
    """
    chosen = load_scenario(scenario, tuple(settings or ()), seed)
    from ortilo_drake.hil.goals.goal_link import ask_goal
    from ortilo_drake.hil.wire.key_file import choose_key

    ask_goal(url, choose_key(url, key, insecure), chosen, x, y, wait)
    out.print(f"goal ({x:g}, {y:g}): flies there", markup=False)
