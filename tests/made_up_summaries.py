"""Made-up summaries of flights."""

from ortilo_drake.flight.summary import Loss, Summary


def made_up_summary(
    mse: tuple[float, float, float],
    path: float | None = 0.01,
    lost: str | None = None,
    touched: tuple[str, ...] = (),
    floor: tuple[float, float, float] | None = (0.01, 0.02, 0.03),
    path_distance_mse: float = 0.02,
) -> Summary:
    """Return a summary with these errors [m^2]."""
    least = None if floor is None else dict(zip("xyz", floor, strict=True))
    over = {axis: None if least is None else m / least[axis] for axis, m in zip("xyz", mse, strict=True)}
    return Summary(
        scenario="made up",
        seed=0,
        lost=None if lost is None else Loss(1.0, lost),
        contacts=list(touched),
        mse=dict(zip("xyz", mse, strict=True)),
        floor=least,
        efficiency=over,
        tick_efficiency={axis: value and 2.0 * value for axis, value in over.items()},
        path_mse=path,
        path_distance_mse=path_distance_mse,
        max_path_distance=0.3,
        max_reference_distance=0.4,
        arrivals={"uwb": 0.7, "camera": None},
        fix_errors={},
        nees=3.0,
        nis={"uwb": 3.0},
        player="engine",
        real_time_factor=100.0,
    )
