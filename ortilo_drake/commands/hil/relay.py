"""The command `ortilo hil relay`: a faulty link between the halves."""

from typing import Annotated

import typer

from ortilo_drake.commands.hil.options import InsecureOption, KeyOption
from ortilo_drake.commands.options import JsonOption, finite
from ortilo_drake.commands.terminal import say_written, show_report, write_json
from ortilo_drake.hil.wire.urls import DEFAULT_URL, ONBOARD_URL


def relay(
    faults: Annotated[
        str, typer.Option(help="Faults in both directions, in SI units: '{loss: 0.2, delay: 0.04, spread: 0.02, ...}'.")
    ] = "{}",
    to_onboard: Annotated[
        str | None, typer.Option(help="Faults on the way to the onboard half, instead of --faults.")
    ] = None,
    to_world: Annotated[str | None, typer.Option(help="Faults on the way to the world, instead of --faults.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of all random numbers.")] = 1,
    url_world: Annotated[str, typer.Option(help="The world's address, which the relay joins.")] = DEFAULT_URL,
    url_onboard: Annotated[str, typer.Option(help="The onboard half's address, which the relay serves.")] = ONBOARD_URL,
    key: KeyOption = None,
    insecure: InsecureOption = False,
    seconds: Annotated[
        float, typer.Option(min=0.0, callback=finite, help="Stop after this time [s]; Ctrl-C stops it too.")
    ] = 86400.0,
    json_file: JsonOption = None,
) -> None:
    """Forward packets between the halves, with faults such as losses and delays; each half has its own address."""
    from ortilo_drake.hil.relay.relay import Faults, run_relay
    from ortilo_drake.hil.wire.address import leaves_machine
    from ortilo_drake.hil.wire.key_file import choose_key
    from ortilo_drake.model.typed_yaml import parse_yaml, validate

    there, back = (
        validate(Faults, parse_yaml(text, option), option)
        for option, text in (
            ("--faults" if to_onboard is None else "--to-onboard", faults if to_onboard is None else to_onboard),
            ("--faults" if to_world is None else "--to-world", faults if to_world is None else to_world),
        )
    )
    secret = choose_key(url_onboard if leaves_machine(url_onboard) else url_world, key, insecure)
    counts = run_relay(secret, url_world, url_onboard, there, back, seed, seconds)
    write_json(json_file, counts)
    show_report(counts)
    say_written(json_file)
