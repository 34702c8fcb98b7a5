"""Messages put together tick by tick, whatever order they come in."""

from hypothesis import given
from hypothesis import strategies as st

from ortilo_drake.hil.wire.inbox import TickInbox
from ortilo_drake.hil.wire.unpack import Packet

TICKS = 12
messages = st.lists(
    st.tuples(st.sampled_from(["imu", "uwb", "detections"]), st.integers(0, TICKS - 1), st.integers(0, 5)),
    max_size=30,
    unique_by=lambda message: message[:2],
)


def taken(arrivals: list[tuple[str, int, int]], keep: int) -> tuple[list[dict[str, int]], int]:
    """Return what is taken in each tick, messages (port, tick, delay) having come, and how many were given up.

    A message's value is the tick it is of.
    """
    inbox, given = TickInbox(), []
    for k in range(2 * TICKS):
        for name, tick, delay in arrivals:
            if tick + delay == k:
                inbox.put(Packet(name, tick, tick))
        given.append(inbox.pop_until(k, keep_from=k + 1 - keep))
    return given, inbox.overtaken


@given(messages)
def test_of_several_on_a_port_the_newest_is_taken_and_the_others_given_up(
    arrivals: list[tuple[str, int, int]],
) -> None:
    given, overtaken = taken(arrivals, 0)
    for k, here in enumerate(given):
        for name in ("imu", "uwb", "detections"):
            came = [tick for port, tick, delay in arrivals if port == name and tick + delay == k]
            assert here.get(name, -1) == max(came, default=-1)
    assert overtaken == len(arrivals) - sum(len(here) for here in given)


@given(messages, st.integers(1, 8))
def test_what_may_be_used_late_is_taken_once_while_it_may(arrivals: list[tuple[str, int, int]], keep: int) -> None:
    given, overtaken = taken(arrivals, keep)
    used = [(name, tick) for here in given for name, tick in here.items()]
    assert len(set(used)) == len(used)
    assert set(used) <= {(name, tick) for name, tick, _ in arrivals}
    assert overtaken == len(arrivals) - len(used)
    for name, tick, delay in arrivals:
        if (name, tick) not in used:  # another was taken on its port in every tick in which it could have been
            assert all(name in given[k] for k in range(tick + delay, tick + keep))


def test_with_time_enough_nothing_is_given_up() -> None:
    arrivals = [("imu", tick, 6 - tick) for tick in range(6)]  # all of them in tick 6
    given, overtaken = taken(arrivals, 30)
    assert [here.get("imu") for here in given[6:12]] == [5, 4, 3, 2, 1, 0]
    assert overtaken == 0


def test_a_tick_is_complete_with_all_that_its_list_names() -> None:
    inbox = TickInbox()
    inbox.put(Packet("imu", 3, 3))
    assert not inbox.is_complete(3)
    inbox.put(Packet("tick", 3, ("imu", "uwb")))
    assert not inbox.is_complete(3)
    inbox.put(Packet("uwb", 3, 3))
    assert inbox.is_complete(3)
    assert inbox.pop(3) == {"imu": 3, "uwb": 3}
    assert not inbox.is_complete(3)


def test_what_is_taken_is_forgotten_with_its_list_and_what_comes_next_is_not() -> None:
    inbox = TickInbox()
    for tick in (3, 4):
        inbox.put(Packet("tick", tick, ("imu",)))
        inbox.put(Packet("imu", tick, tick))
    assert inbox.pop_until(3, keep_from=3) == {"imu": 3}
    assert inbox.is_complete(4)
    inbox.put(Packet("imu", 3, 3))  # again, for a tick that is done
    assert not inbox.is_complete(3)
    assert inbox.pop(4) == {"imu": 4}
    inbox.put(Packet("imu", 4, 4))
    assert not inbox.is_complete(4)


def test_a_tick_that_may_still_be_used_is_kept_and_the_one_before_it_is_not() -> None:
    for keep_from, left, given_up in [(2, {"imu": 2}, 0), (3, {}, 1)]:
        inbox = TickInbox()
        for tick in (2, 3):
            inbox.put(Packet("imu", tick, tick))
        assert inbox.pop_until(3, keep_from) == {"imu": 3}
        assert inbox.overtaken == given_up
        assert inbox.pop_until(4, keep_from) == left
        assert inbox.overtaken == given_up
