"""The laboratory in Python: the same flights as the command line's, by fewer words."""

import gc
import subprocess
import sys
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from distributed import LocalCluster, SpecCluster
from IPython.core.formatters import DisplayFormatter
from made_up_summaries import made_up_summary
from matplotlib import image
from matplotlib.figure import Figure
from pydrake.systems.framework import Diagram
from scipy.spatial.transform import Rotation
from scipy.stats import binomtest

import ortilo_drake as od
from ortilo_drake.api import flights
from ortilo_drake.flight.flight import fly as fly_dataset
from ortilo_drake.flight.metrics import estimation_mse, summary
from ortilo_drake.flight.processes import cluster
from ortilo_drake.interop.log.reader import read_log
from ortilo_drake.model.as_data import as_data
from ortilo_drake.model.room import ORTILO_ROOM
from ortilo_drake.scenario import BernoulliLoss, NoLoss, load_scenario
from ortilo_drake.views.numbers import number

HOVER = {"planner": {"kind": "hover", "duration": 1.0}, "settle": 0.0}
WORDS = ("planner={kind: hover, duration: 1.0}", "settle=0.0", "uwb.link.loss=0.3")


@pytest.fixture(scope="module")
def flown() -> od.Flight:
    return od.fly("nominal_imu_uwb", seed=3, uwb__link__loss=0.3, **HOVER)


def test_errors_and_deviations_of_the_whole_state_have_the_names_and_units_of_the_truth(flown: od.Flight) -> None:
    """estimate - truth of the Dataset has two dimensions of states, which xarray multiplies out."""
    truth, estimate, P = (flown.data[name].values for name in ("truth", "estimate", "covariance"))
    assert flown.errors.dims == flown.sigma.dims == ("tick", "state")
    np.testing.assert_allclose(flown.errors.values, estimate[:, :12] - truth, atol=1e-12)
    np.testing.assert_array_equal(flown.errors.sel(state=["x", "y", "z"]).values, flown.error.values)
    np.testing.assert_allclose(flown.sigma.values**2, P[:, range(12), range(12)])
    turned = od.Flight(flown.data.assign(truth=flown.data["truth"] + 2.0 * np.pi * (flown.data["state"] == "psi")))
    np.testing.assert_allclose(turned.errors.values, flown.errors.values, atol=1e-12)


@pytest.mark.long
def test_importing_loads_neither_drake_nor_numpy_and_dir_shows_what_there_is() -> None:
    program = "import sys, ortilo_drake as od; print(*sys.modules); print(*dir(od))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    modules, names = (set(line.split()) for line in done.stdout.splitlines())
    assert not {"pydrake", "numpy", "ortilo_drake.api"} & modules
    assert {"Flight", "compare", "fly", "fly_many", "load_scenario", "make_closed_loop"} <= names
    assert not {"Any", "TYPE_CHECKING", "import_module"} & names


def test_a_name_that_is_not_there_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="flyy"):
        _ = od.flyy  # type: ignore[attr-defined]


def test_keywords_are_the_settings_of_the_command_line() -> None:
    assert od.load_scenario("nominal_imu_uwb", seed=3, uwb__link__loss=0.3, **HOVER) == load_scenario(
        "nominal_imu_uwb", WORDS, 3
    )
    assert od.load_scenario(load_scenario("nominal_imu_uwb"), seed=3, uwb__link__loss=0.3, **HOVER) == load_scenario(
        "nominal_imu_uwb", WORDS, 3
    )
    numbers = {"estimator__W__force_density": np.float64(0.0365)}
    assert od.load_scenario("nominal_imu_uwb", **numbers) == load_scenario(
        "nominal_imu_uwb", ("estimator.W.force_density=0.0365",)
    )


def test_settings_as_text_and_by_keyword_are_one() -> None:
    by_word = od.load_scenario("nominal_imu_uwb", "uwb.link.loss=0.3", seed=3)
    assert by_word == od.load_scenario("nominal_imu_uwb", uwb__link__loss=0.3, seed=3)
    assert by_word == od.load_scenario(od.load_scenario("nominal_imu_uwb"), ["seed=3"], uwb__link__loss=np.float64(0.3))
    assert (
        od.load_scenario("nominal_imu_uwb", "uwb.link.loss=0.3", uwb__link__loss=0.1).uwb.link.loss.probability == 0.1
    )
    assert od.fly("nominal_imu_uwb", WORDS, seed=3).scenario == load_scenario("nominal_imu_uwb", WORDS, 3)
    assert by_word == od.load_scenario("nominal_imu_uwb", {"uwb.link.loss": 0.3, "seed": 3})
    assert od.load_scenario is load_scenario
    with pytest.raises(od.InputError, match=r"^settings: 0.3: must be 'key.key=value'"):
        od.load_scenario("nominal_imu_uwb", [0.3])  # type: ignore[list-item]


def test_values_are_those_of_yaml_and_pythons_own_like_them(tmp_path: Path) -> None:
    room = tmp_path / "room.yaml"
    room.write_text(ORTILO_ROOM.read_text())
    loss = BernoulliLoss(kind="bernoulli", probability=0.3)
    planner = {"kind": "hover", "point": np.array([8.0, 1.0, 1.5])}
    found = od.load_scenario("nominal_imu_uwb", seed=np.int64(3), room=room, uwb__link__loss=loss, planner=planner)
    words = (f"room={room}", "uwb.link.loss=0.3", "planner={kind: hover, point: [8.0, 1.0, 1.5]}")
    assert found == load_scenario("nominal_imu_uwb", words, 3)
    assert od.load_scenario("nominal_imu_uwb", uwb=found.uwb).uwb == found.uwb
    assert od.load_scenario("nominal_imu_uwb", estimator__W__force_density=1e-7).estimator.W.force_density == 1e-7


@pytest.mark.parametrize(
    ("value", "field", "kind"),
    [({"loss": object()}, "uwb.link.loss", "object"), ({"loss": [1, 1j]}, "uwb.link.loss.1", "complex")],
)
def test_a_value_of_no_type_that_yaml_has_is_refused_by_field_and_type(value: Any, field: str, kind: str) -> None:
    with pytest.raises(od.InputError, match=rf"^{field}: .*not a {kind}$") as error:
        od.load_scenario("nominal_imu_uwb", uwb__link=value)
    assert "\n" not in str(error.value)


def test_a_number_is_independent_loss_and_nought_none() -> None:
    assert od.load_scenario("nominal_imu_uwb", uwb__link__loss=0.3).uwb.link.loss == BernoulliLoss(
        kind="bernoulli", probability=0.3
    )
    assert od.load_scenario("nominal_imu_uwb", uwb__link__loss=0).uwb.link.loss == NoLoss()


@pytest.mark.parametrize(("settings", "named"), [({"uwb__link__los": 0.3}, "loss"), ({"uwb__link__loss": 1.3}, "1.3")])
def test_what_is_wrong_is_said_in_one_line(settings: dict[str, float], named: str) -> None:
    with pytest.raises(od.InputError, match=named) as error:
        od.fly("nominal_imu_uwb", **settings)
    assert "\n" not in str(error.value)


def test_a_flight_is_that_of_the_command_line(flown: od.Flight) -> None:
    data = fly_dataset(load_scenario("nominal_imu_uwb", WORDS, 3))
    xr.testing.assert_equal(flown.data, data)
    assert flown.seed == 3
    assert flown.lost is None
    assert flown.scenario == load_scenario("nominal_imu_uwb", WORDS, 3)
    found, expected = flown.summary(), as_data(summary(data))
    assert (found.pop("player"), expected.pop("player")) == ("engine", "drake")
    assert {**found, "real_time_factor": 0} == {**expected, "real_time_factor": 0}
    for axis, value in estimation_mse(data).items():
        np.testing.assert_allclose((flown.error.sel(axis=axis) ** 2).mean(), value, rtol=1e-12)


def test_a_flight_says_what_it_is_in_one_line(flown: od.Flight) -> None:
    rms = np.sqrt(sum(flown.summary()["mse"].values()))
    assert repr(flown) == f"<Flight nominal_imu_uwb, seed 3: 1.0 s, reached its end, RMS error {rms:.3f} m>"


def test_a_lost_flight_says_when_and_why() -> None:
    low = {"kind": "hover", "point": [8.0, 1.0, 0.02], "duration": 5.0}
    lost = od.fly("nominal_imu_uwb", planner=low)
    assert lost.lost is not None
    assert f"lost at {lost.lost['time']:.1f} s: left the room" in repr(lost)


def test_a_plot_is_a_figure_with_path_errors_and_arrivals(flown: od.Flight) -> None:
    figure = flown.plot()
    assert isinstance(figure, Figure)
    assert len(figure.axes) == 5
    rows = [label.get_text() for label in figure.axes[-1].get_yticklabels()]
    assert rows == [name.replace("uwb", "UWB") for name in ("camera", "uwb") if name in flown.scenario.sensors]


def test_a_notebook_shows_each_figure_of_a_flight_by_itself(flown: od.Flight) -> None:
    """Without `%matplotlib inline`, IPython shows a figure that matplotlib.pyplot did not make as text alone."""
    for figure in (flown.plot(), flown.plot_blackouts(), flown.plot_availability()):
        shown, _ = DisplayFormatter().format(figure)
        assert shown["image/png"].startswith(b"\x89PNG")


def test_a_plot_takes_the_command_lines_themes(flown: od.Flight, tmp_path: Path) -> None:
    flown.plot("slides").savefig(tmp_path / "slides.png")
    assert image.imread(tmp_path / "slides.png").shape[1] == 1920  # a slide's width [px]
    flown.plot_blackouts(theme="dark").savefig(tmp_path / "dark.png")
    assert image.imread(tmp_path / "dark.png")[0, 0, :3].max() < 0.2  # the ground
    assert flown.plot_availability(theme="print").dpi == 300


def test_blackouts_and_availability_are_figures_of_that_flight(flown: od.Flight) -> None:
    (axes,) = flown.plot_blackouts("z").axes
    np.testing.assert_array_equal(axes.get_lines()[0].get_ydata(), abs(flown.error.sel(axis="z")))
    assert f"seed {flown.seed}" in axes.get_title(loc="left")
    assert [axes.get_ylabel() for axes in flown.plot_availability().axes] == [
        "error of a fix [m]",
        "share of due fixes used [-]",
    ]


@pytest.mark.long
def test_netcdf_comes_back(flown: od.Flight, tmp_path: Path) -> None:
    again = od.Flight.load(flown.to_netcdf(tmp_path / "flight.nc"))
    xr.testing.assert_identical(again.data, flown.data)


def test_an_entry_of_the_covariance_has_names_and_the_error_its_unit(flown: od.Flight) -> None:
    np.testing.assert_array_equal(
        flown.data["covariance"].sel(xbar="x", xbar_column="y_dot"), flown.data["covariance"].values[:, 0, 7]
    )
    assert list(flown.data["xbar"].values[[0, 7]]) == ["x", "y_dot"]
    assert flown.error.attrs == {"units": "m", "long_name": "error of the estimated position"}


@pytest.mark.long
def test_a_page_tells_of_its_flight_and_the_terminal_nothing(
    flown: od.Flight, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level("INFO", "drake"):  # Drake's own level
        page = flown.to_html(tmp_path / "flight.html").read_text(encoding="utf-8")
    assert f"<h1>{flown.scenario.name}, seed {flown.seed}</h1>" in page
    assert not caplog.records


def test_a_table_has_every_number_of_the_flight_and_its_unit(flown: od.Flight) -> None:
    table, data = flown.to_pandas(), flown.data
    outputs, sensors = data.sizes["output"], data.sizes["sensor"]
    assert table.shape == (data.sizes["tick"], 12 + 15 + 4 + 9 + 2 * sensors + 2 * outputs + 15 * 16 // 2)
    np.testing.assert_array_equal(table.index, data["time"])
    np.testing.assert_array_equal(table["covariance.y.theta_dot"], data["covariance"].values[:, 1, 10])
    np.testing.assert_array_equal(table["arrival.uwb"], data["arrival"].sel(sensor="uwb"))
    # an innovation is there with each arrival, and is what was measured less the position that was expected
    arrived = table["arrival.uwb"]
    assert 0 < arrived.sum() < arrived.size
    assert (table["innovation.x_uwb"].notna() == arrived).all()
    expected = (table["measurement.x_uwb"] - table["estimate.x"])[arrived]
    np.testing.assert_array_equal(table["innovation.x_uwb"][arrived], expected)
    units = table.attrs["units"]
    assert list(units) == ["time", *table.columns]
    for column, unit in {
        "estimate.phi_dot": "rad/s", "estimate.i_z": "m", "control.f_T": "N", "covariance.x.x": "m^2",
        "covariance.z.theta": "m rad", "covariance.x_dot.x_dot": "(m/s)^2", "innovation.psi_imu": "rad", "due.imu": "1",
    }.items():  # fmt: skip
        assert units[column] == unit


def test_csv_is_that_table_to_the_last_bit(flown: od.Flight, tmp_path: Path) -> None:
    file, table = flown.to_csv(tmp_path / "flight.csv"), flown.to_pandas()
    again = pd.read_csv(file, index_col="time")
    assert list(again.columns) == list(table.columns)
    np.testing.assert_array_equal(again.index, table.index)
    np.testing.assert_array_equal(again.to_numpy(float), table.to_numpy(float))
    rows = np.loadtxt(file, delimiter=",", skiprows=1)  # of numbers alone, with a 1 for True
    np.testing.assert_array_equal(rows[:, 1 + table.columns.get_loc("arrival.uwb")], table["arrival.uwb"])


@pytest.mark.parametrize("of", ["estimate", "truth"])
def test_tum_holds_position_and_attitude(flown: od.Flight, tmp_path: Path, of: str) -> None:
    rows = np.loadtxt(flown.to_tum(tmp_path / "path.tum", of))
    np.testing.assert_allclose(rows[:, :4], np.column_stack([flown.data["time"], flown.data[of][:, :3]]), atol=1e-9)
    angles = Rotation.from_quat(rows[:, 4:]).as_euler("ZYX")[:, ::-1]
    np.testing.assert_allclose(angles, flown.data[of][:, 3:6], atol=1e-8)


def test_tum_of_nothing_known_is_refused(flown: od.Flight, tmp_path: Path) -> None:
    with pytest.raises(od.InputError, match="covariance"):
        flown.to_tum(tmp_path / "path.tum", "covariance")


def test_a_log_gives_the_flight_back(flown: od.Flight, tmp_path: Path) -> None:
    again = read_log(flown.to_mcap(tmp_path / "log"))
    for name in ("truth", "estimate", "covariance", "control", "reference", "measurement", "arrival"):
        np.testing.assert_array_equal(again[name].values, flown.data[name].values)


@pytest.mark.long
def test_many_flights_are_a_sequence_and_a_table(tmp_path: Path) -> None:
    flights = od.fly_many("nominal_imu_uwb", [4, 2], out=tmp_path, **HOVER)
    assert [flight.seed for flight in flights] == [4, 2]
    assert flights[-1].seed == 2
    assert [flight.seed for flight in flights[:1]] == [4]
    table = flights.table()
    assert list(table.index) == [4, 2]
    assert table.loc[4, "mse x"] == flights[0].summary()["mse"]["x"]
    assert repr(flights) == "<Flights nominal_imu_uwb: 2, 0 lost>"
    xr.testing.assert_equal(flights[0].data, od.fly("nominal_imu_uwb", seed=4, **HOVER).data)


@pytest.mark.long
def test_flights_without_a_folder_keep_theirs_while_they_live() -> None:
    flights = od.fly_many("nominal_imu_uwb", [1], **HOVER)
    folder = flights._out
    assert flights[0].seed == 1
    del flights
    gc.collect()
    assert not folder.exists()


@pytest.mark.long
def test_a_comparison_has_medians_of_the_same_seeds() -> None:
    found = od.compare("nominal_imu_uwb", "nominal_imu_uwb_yolo", seeds=range(3), camera__kind="projected", **HOVER)
    assert list(found.index) == ["nominal_imu_uwb", "nominal_imu_uwb_yolo"]
    each = [od.fly("nominal_imu_uwb", seed=seed, **HOVER).summary()["mse"]["x"] for seed in range(3)]
    assert found.loc["nominal_imu_uwb", "mse x"] == np.median(each)
    assert found.loc["nominal_imu_uwb", "flights"] == 3
    assert found.loc["nominal_imu_uwb", "lost"] == 0
    with pd.option_context("display.width", 40, "display.max_columns", 3):  # a narrow screen
        shown = f"{found}".splitlines()
    assert len(shown) == 1 + len(found) + 1
    assert all(column in shown[0] for column in ("lost", "mse x [m^2]", "path mse [m^2]", "nees [1]", "player"))
    assert shown[-1].startswith("[?]: too few flights: the 95 % interval")
    assert "0 of 3 [0, 56 %]" in shown[1]
    assert f"{number(float(np.median(each)))} [?]" in shown[1]  # three flights have no interval
    assert np.isnan(found.loc["nominal_imu_uwb", "mse x low"])
    assert f"{found[['lost']]}".split() == ["lost", "nominal_imu_uwb", "0", "nominal_imu_uwb_yolo", "0"]


def test_a_comparison_counts_lost_flights_as_worst(monkeypatch: pytest.MonkeyPatch) -> None:
    summaries = [asdict(made_up_summary((0.01 * (k + 1),) * 3, lost="tumbled" if k < 3 else None)) for k in range(9)]

    def flown(*_: object, **__: object) -> od.Flights:
        return od.Flights(od.load_scenario("nominal_imu_uwb"), list(range(9)), Path(), summaries)

    monkeypatch.setattr(flights, "fly_many", flown)
    (row,) = od.compare("nominal_imu_uwb", seeds=range(9)).to_dict("records")
    share = binomtest(3, 9).proportion_ci(0.95, method="wilson")
    assert (row["lost low"], row["lost high"]) == pytest.approx((share.low, share.high))
    assert (row["mse x"], row["mse x low"], row["mse x high"]) == pytest.approx((0.08, 0.05, np.inf))
    assert (row["mse x kept"], row["mse x kept low"], row["mse x kept high"]) == pytest.approx((0.065, 0.04, 0.09))
    shown = f"{od.compare('nominal_imu_uwb', seeds=range(9))}"
    assert "3 of 9 [12, 65 %]" in shown
    assert "0.08 [0.05, lost]; kept 0.07 [0.04, 0.09]" in shown


@pytest.mark.long
def test_a_comparison_has_a_row_for_each_scenario_even_of_one_name() -> None:
    worse = od.load_scenario("nominal_imu_uwb", uwb__link__loss=0.5)
    found = od.compare("nominal_imu_uwb", worse, seeds=[1, 2], **HOVER)
    assert list(found.index) == ["nominal_imu_uwb", "nominal_imu_uwb"]
    for k, loss in enumerate((None, 0.5)):
        each = [
            od.fly("nominal_imu_uwb", seed=seed, uwb__link__loss=loss or 0, **HOVER).summary()["mse"]["x"]
            for seed in (1, 2)
        ]
        assert found["mse x"].iloc[k] == np.median(each)


@pytest.mark.processes
def test_a_comparison_starts_its_workers_once(monkeypatch: pytest.MonkeyPatch) -> None:
    started = []

    def start(count: int) -> SpecCluster:
        started.append(count)  # one worker in this process will do: test_workers.py has those of their own
        return LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None)

    monkeypatch.setattr(cluster, "start_cluster", start)
    found = od.compare("nominal_imu_uwb", "paper_imu_uwb", seeds=range(2), workers=2, **HOVER)
    assert list(found["flights"]) == [2, 2]
    assert started == [2]


def test_the_closed_loop_is_drakes() -> None:
    assert isinstance(od.make_closed_loop(od.load_scenario("nominal_imu_uwb")), Diagram)


def test_linearize_tells_what_drake_would_end_python_on() -> None:
    loop = od.make_closed_loop(od.load_scenario("nominal_imu_uwb"))
    for reference in ([0.0, 0.0, 1.5], [np.nan] * 9):
        with pytest.raises(od.InputError, match=r"^reference: .*must be r, r_dot, r_ddot: 9 finite numbers"):
            od.linearize("nominal_imu_uwb", "plant", reference=np.array(reference))
    assert "12 states: x, y, z, phi" in repr(od.linearize("nominal_imu_uwb", "plant"))
    with pytest.raises(od.InputError, match=r"^scenario: a ClosedLoop: must be a scenario or its name"):
        od.linearize(loop, "plant")  # type: ignore[arg-type]
    heavier = od.linearize("nominal_imu_uwb", "plant", "vehicle.mass=5.0")
    assert heavier.frame("B").loc["z_dot", "f_T"] == pytest.approx(1.0 / 5.0, rel=1e-12)


@pytest.mark.long
def test_tables_have_the_paper_beside_ours(tmp_path: Path) -> None:
    found = od.tables("altimeter", flights=1, out=tmp_path, camera__kind="projected", **HOVER)
    assert set(found.table.index.unique("scenario")) == {"imu_uwb", "imu_uwb_yolo", "altimeter"}
    assert found.table.loc[("imu_uwb", "median"), "paper x"] == 0.0993  # of the paper's table I
    flight = od.fly("altimeter", seed=0, camera__kind="projected", **HOVER)
    assert found.table.loc[("altimeter", "mean"), "x"] == pytest.approx(flight.summary()["mse"]["x"], rel=1e-12)
    assert f"{found}".startswith("# The paper's tables, preset 'tuned', 1 flights a scenario")
    with pytest.raises(od.InputError, match=r"^preset: 'tune': must be one of tuned, nominal, paper, printed$"):
        od.tables(preset="tune")


def test_a_map_has_a_row_for_each_point() -> None:
    sweep = {"scenario": "nominal_imu_uwb", "settings": HOVER, "axes": {"uwb.link.loss": [0.0, 1.0]}, "flights": 2}
    found = od.map(sweep)
    assert list(found.table["arrived_uwb"]) == [1.0, 0.0]
    assert list(found.table["flights"]) == [2, 2]
    assert [row["point"] for row in found.data["rows"]] == [{"uwb.link.loss": 0.0}, {"uwb.link.loss": 1.0}]
    with pytest.raises(od.InputError, match=r"^sweep: axes"):
        od.map(sweep | {"axes": {}})


@pytest.mark.parametrize(
    ("call", "line"),
    [
        (lambda: od.fly_many("nominal_imu_uwb", 4), r"^seeds: 4: must be several, as range\(4\) or \[4\]$"),
        (lambda: od.compare("nominal_imu_uwb", seeds=4), "^seeds: 4: must be several"),
        (lambda: od.compare(seeds=range(2)), "^scenarios: none given: must be one or more$"),
        (lambda: od.fly_many("nominal_imu_uwb", [1, 2], workers=0), "^workers: 0: must be 1 or more$"),
        (lambda: od.compare("nominal_imu_uwb", seeds="ab"), "^seeds: 'a': must be integers$"),
        (lambda: od.load_scenario("imu_uwb", 5), "^settings: 5: must be 'key.key=value', several of these, or a dict"),
        (
            lambda: od.fly("imu_uwb", estimator=lambda belief, x: None),
            "^estimator: its function returned None: must be",
        ),
        (lambda: od.make_imu(h=-1.0), r"^h: -1\.0: must be 0\.001 to 0\.2 s$"),
        (lambda: od.make_imu(3), "^settings: 3: must be those of an IMU"),
        (lambda: od.make_plant(time_step="a"), "^time_step: 'a': must be 0 or positive$"),
        (lambda: od.register_sensor(3), r"^sensor: 3: must be an od\.Sensor$"),
        (lambda: od.linearize("imu_uwb", "plant").frame("E"), "^matrix: 'E': must be one of A, B, C, D$"),
        (lambda: od.linearize("imu_uwb", "plant", reference="x"), r"^reference: has the shape \(\)"),
        (lambda: od.fly("nominal_imu_uwb", **HOVER).plot_blackouts("w"), "^axis: 'w': must be one of x, y, z$"),
        (lambda: od.fly("nominal_imu_uwb", **HOVER).plot("slide"), "^theme: 'slide': must be one of light, dark, sl"),
        (lambda: od.fly(3), "^scenario: 3: must be a ready-made one's name or a .yaml file$"),
        (lambda: od.make_closed_loop("imu_ubw"), "^scenario: 'imu_ubw' is unknown"),
    ],
)
def test_a_wrong_argument_is_told_in_a_line(call: Callable[[], Any], line: str) -> None:
    with pytest.raises(od.InputError, match=line):
        call()
