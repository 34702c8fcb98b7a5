"""The commands `ortilo hil`: the two halves in two processes, and what stands between and beside them."""

import typer

from ortilo_drake.commands.hil_bridge import bridge
from ortilo_drake.commands.hil_check import check
from ortilo_drake.commands.hil_goal import goal
from ortilo_drake.commands.hil_key import key
from ortilo_drake.commands.hil_onboard import onboard
from ortilo_drake.commands.hil_relay import relay
from ortilo_drake.commands.hil_world import world

hil_app = typer.Typer(no_args_is_help=True, help="Hardware in the loop: the two halves in two processes, over LCM.")
for command in (world, onboard, check, relay, bridge, key):
    hil_app.command()(command)
hil_app.command(context_settings={"ignore_unknown_options": True})(goal)  # -2 is a number, no option
