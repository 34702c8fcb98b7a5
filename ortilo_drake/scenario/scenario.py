"""The scenario: everything that decides a flight, and nothing else."""

import json
from typing import Annotated, Any, Final

from pydantic import Field, model_validator

from ortilo_drake.model.parts import find_sensor, own_sensors
from ortilo_drake.model.signals import SENSORS
from ortilo_drake.model.typed_yaml import InputError, nearest, validate
from ortilo_drake.scenario.belief import Belief
from ortilo_drake.scenario.camera import Camera
from ortilo_drake.scenario.faults import Faults, check_faults, sensors_of_kind
from ortilo_drake.scenario.link import CommandLink, Link, check_rate
from ortilo_drake.scenario.loss_chain import loss_parameters
from ortilo_drake.scenario.onboard import LqServo
from ortilo_drake.scenario.sensors import Imu, Uwb
from ortilo_drake.scenario.truth import Truth
from ortilo_drake.scenario.world import Failsafe, World

BIAS_SDS = ("uwb_sd", "camera_sd", "level_sd", "yaw_sd", "row_sd")
Seed = Annotated[int, Field(ge=0, lt=2**63)]


class Scenario(Belief):
    """One flight: the belief of the onboard half, the world, and the differences between the two."""

    imu: Imu = Imu()
    uwb: Uwb = Uwb()
    camera: Camera = Camera()
    seed: Seed = 0
    """the seed of all noise; the same seed gives the same flight bit for bit."""
    settle: Annotated[float, Field(ge=0.0, le=3600.0)] = 2.0
    """time flown after the path's end [s]."""
    seconds: Annotated[float, Field(ge=0.1, le=36000.0)] | None = None
    """time after which the flight ends, on an unchanged path [s]; null flies to the end of the path."""
    world: World = World()
    """the simulated physics apart from the sensors."""
    truth: Truth = Truth()
    """differences of the world from the onboard belief; by default none."""
    faults: Faults = ()
    """faults in the middle of the flight; by default none."""
    command_link: CommandLink = CommandLink()
    """delivery of the control packets; perfect by default."""
    report_link: Link = Link()
    """delivery of the reports that say which commands acted; used only if `commands` needs reports."""
    failsafe: Failsafe = Failsafe()
    """the flight controller's behaviour while no command arrives; only in real time (`ortilo hil world`)."""

    @property
    def belief(self) -> Belief:
        """Everything that the onboard half may know."""
        return validate(Belief, _believed(self.model_dump(mode="json")), self.name)

    def projected(self) -> "Scenario":
        """Return the same scenario with a camera that draws no pictures."""
        return self.model_copy(update={"camera": self.camera.model_copy(update={"kind": "projected"})})

    def link_of(self, sensor: str) -> Link:
        """Return the link of a sensor."""
        link: Link = self.group_of(sensor).link
        return link

    def latency_of(self, sensor: str) -> int:
        """Return the latency of a sensor's messages before they enter its link [ticks]."""
        return self.camera.latency if sensor == "camera" else 0

    @model_validator(mode="after")
    def _links_fit_the_ticks(self) -> "Scenario":
        for sensor in self.sensors:
            rate = self.link_of(sensor).rate
            if rate is not None:
                check_rate(sensor, rate, self.control_rate)
        links: dict[str, Any] = {f"{sensor}.link": self.link_of(sensor) for sensor in {*SENSORS, *self.sensors}}
        for name, link in (links | {"command_link": self.command_link, "report_link": self.report_link}).items():
            try:
                loss_parameters(link.loss, self.h)
            except InputError as error:
                raise ValueError(f"{name}.loss.{error}") from None
        if (rate := self.report_link.rate) is not None:
            if rate > self.control_rate:
                raise ValueError(f"report_link.rate: {rate}: must not exceed {self.control_rate:g} Hz")
            check_rate("report_link", rate, self.control_rate, "report_link.rate")
        return self

    @model_validator(mode="after")
    def _estimator_has_what_it_reads(self) -> "Scenario":
        its, method, bank = self.estimator, self.landmark_fix.method, self.landmark_fix.survey_bank
        force, V = getattr(its, "force", None), getattr(its, "V", None)
        for sensor in dict(getattr(its, "gates", ())):
            if sensor not in self.sensors:
                raise ValueError(f"estimator.gates.{sensor}: must be one of the sensors that fly, {list(self.sensors)}")
        if force == "measured" and "imu" not in self.sensors:
            raise ValueError(
                f"estimator.force: measured: must be none or thrust, no imu in sensors {list(self.sensors)}"
            )
        if getattr(its, "rates", "none") == "measured" and force != "measured":
            raise ValueError("estimator.rates: measured: must be none, or force measured as well")
        if force == "none":
            sds = {f"biases.{name}": getattr(its.biases, name) for name in BIAS_SDS}
            for name, sd in (sds | {"walks.torque_sd": its.walks.torque_sd}).items():
                if any(sd) if isinstance(sd, tuple) else sd:
                    raise ValueError(f"estimator.{name}: {sd}: must be 0 with force none, the paper's filter")
        known = [row.name for sensor in own_sensors() for row in sensor.rows]
        for name in dict(getattr(getattr(its, "biases", None), "row_sd", ())):
            if name not in known:
                raise ValueError(f"estimator.biases.row_sd.{name}: must be a row of a sensor beside {SENSORS}: {known}")
        if V is not None and V.camera is not None and len(self.landmark_fix.rows) > len(V.camera):
            raise ValueError(
                f"estimator.V.camera: {list(V.camera)}: must be null, "
                f"landmark_fix.method {method} gives more than a position"
            )
        if getattr(its, "robust", None) is not None and "camera" in self.sensors:
            for name, learned in (("survey_bank", bank and list(bank)), ("noise_scale", self.landmark_fix.noise_scale)):
                if learned is not None:
                    raise ValueError(f"landmark_fix.{name}: {learned}: must be null with estimator.robust")
        return self

    @model_validator(mode="after")
    def _late_commands_have_a_delay(self) -> "Scenario":
        late, delay = self.commands.servo, self.commands.delay
        if self.commands.filter == "acted" and getattr(self.estimator, "delay", None) != "replay":
            raise ValueError("commands.filter: acted: must be sent, or estimator.delay must be replay")
        if late == "augmented" and delay is None:
            raise ValueError("commands.delay: null: must be a number [s] with servo augmented")
        if late == "augmented" and not isinstance(self.servo, LqServo):
            raise ValueError("commands.servo: augmented: must be present or predicted with a servo of one's own")
        if late != "present" and self.lends_velocities:
            raise ValueError(f"commands.servo: {late}: must be present where servo.velocities are of the truth")
        if late == "present" and self.commands.filter == "sent" and delay is not None:
            raise ValueError(f"commands.delay: {delay}: must be null with filter sent and servo present")
        return self

    @model_validator(mode="after")
    def _world_has_what_flies(self) -> "Scenario":
        for sensor in dict(self.truth.sensors):
            if find_sensor(sensor) is None:
                known = [own.name for own in own_sensors()]
                raise ValueError(f"truth.sensors.{sensor}: is none of the registered sensors{nearest(sensor, known)}")
        check_faults(self.faults, self.sensors, self.is_rendered)
        check_differences(self)
        if self.world.kinematics == "linear" and self.yaw != 0.0:
            raise ValueError(f"servo.yaw: {self.yaw}: must be 0 with world.kinematics linear, the paper's at yaw 0")
        if len(set(self.sensors)) != len(self.sensors):
            raise ValueError(f"sensors: {list(self.sensors)} names one twice")
        return self


def _believed(data: dict[str, Any]) -> dict[str, Any]:
    """Return the part of a scenario's data that the onboard half knows; from each link, only the rate."""
    kept = {key: value for key, value in data.items() if key in Belief.model_fields or key not in Scenario.model_fields}
    for key, group in kept.items():
        if key in SENSORS:
            setup: Any = Belief.model_fields[key].annotation
            group = {name: value for name, value in group.items() if name in setup.model_fields}
        if key == "uwb" and group["behind_walls"] is None:
            lengthen = data["uwb"]["walls"]["kind"] in ("bias", "excess")
            group["behind_walls"] = "left_out" if lengthen else "used"
        if isinstance(group, dict) and isinstance(group.get("link"), dict):
            kept[key] = group | {"link": {"rate": group["link"]["rate"]}}
    return kept


FORMAT: Final = 2  # version of the scenario's JSON in a flight or a log
_WHOLE = 1e-6  # tolerance within which a number of packets counts as whole


def check_differences(scenario: Any) -> None:
    """Raise ValueError if settings read or change single ranges although the UWB sensor sends differences."""
    uwb, estimator = scenario.uwb, scenario.estimator
    if uwb.kind != "differences" or "uwb" not in scenario.sensors:
        return
    with_it = "with uwb.kind differences"
    if getattr(estimator, "kind", None) != "tight":
        raise ValueError(f"estimator.kind: {getattr(estimator, 'kind', None)}: must be tight {with_it}")
    if estimator.ranges.differences:
        raise ValueError(f"estimator.ranges.differences: true: must be false {with_it}, which have no clock error")
    exact = uwb.packets * uwb.link.every(scenario.h) * scenario.h
    if uwb.rows(scenario.h) < 1 or abs(exact - uwb.rows(scenario.h)) > _WHOLE:
        raise ValueError(f"uwb.packets: {uwb.packets:g}: must be a whole number, 1 or more, in each message: {exact:g}")
    if uwb.round > 0.0:
        raise ValueError(f"uwb.round: {uwb.round:g}: must be 0 {with_it}, which come one by one")
    if uwb.walls.kind not in ("none", "block"):
        raise ValueError(f"uwb.walls.kind: {uwb.walls.kind}: must be none or block {with_it}")
    if uwb.behind_walls == "left_out":
        raise ValueError(f"uwb.behind_walls: left_out: must be used or null {with_it}")
    for i, fault in enumerate(scenario.faults):
        if "uwb" in sensors_of_kind(getattr(fault, "kind", "")):
            raise ValueError(f"faults.{i}: {fault.kind}: changes single ranges: uwb.kind must be ranges")


def scenario_from_json(text: str, version: Any, source: str) -> Scenario:
    """Return the scenario that a flight or a log holds as JSON; `version` is the stored format, or None.

    InputError, beginning with `source`, if the text is no scenario of this format; ValueError if it is no JSON.
    """
    if version != FORMAT:
        raise InputError(f"{source}: is of format {version}, this version reads format {FORMAT}")
    return validate(Scenario, json.loads(text), source)
