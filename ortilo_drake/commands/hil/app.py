"""The commands `ortilo hil`: the two halves as processes, a relay between them, and programs that listen to them."""

import typer

from ortilo_drake.commands.hil.bridge import bridge
from ortilo_drake.commands.hil.check import check
from ortilo_drake.commands.hil.goal import goal
from ortilo_drake.commands.hil.key import key
from ortilo_drake.commands.hil.onboard import onboard
from ortilo_drake.commands.hil.relay import relay
from ortilo_drake.commands.hil.world import world

hil_app = typer.Typer(
    no_args_is_help=True, help="Hardware in the loop: the two halves in two processes or on two machines."
)
for command in (world, onboard, check, relay, bridge, key):
    hil_app.command()(command)
hil_app.command(context_settings={"ignore_unknown_options": True})(goal)  # -2 is a number, not an option
