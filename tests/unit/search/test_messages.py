"""Messages: what robots tell on the wire, signatures, replays, fragments, and all that nobody can
say.
"""

from __future__ import annotations

import numpy as np
import pytest

from shoal.core.errors import InvalidInputError
from shoal.search import TourCost, make_tour
from shoal.search.problem.fields import read_key
from shoal.search.problem.network import network_of
from shoal.search.protocol.messages import (
    Beacon,
    Heartbeat,
    Receiver,
    Sender,
    decode_beacon,
    encode_beacon,
)
from shoal.search.protocol.robot import advance
from shoal.search.protocol.state import Begin, Brief, Heard, Robot, Send, Wake
from shoal.search.simulation.scenario import Scenario
from shoal.search.simulation.world import SearchWorld
from shoal.search.tours.masks import bits_of_intervals, intervals, members

KEY = b"0123456789abcdef"


def random_beacon(rng, cells, robots=9):
    def some():
        return bits_of_intervals(
            [
                (int(first), int(rng.integers(1, 9)))
                for first in rng.integers(0, cells - 9, rng.integers(1, 40))
            ]
        )

    numbers = rng.permutation(np.arange(1, robots))
    heartbeats = tuple(
        Heartbeat(
            int(number),
            int(rng.integers(1 << 20)),
            int(rng.integers(cells)),
            float(rng.choice([1.0, 1 / 3])),
            str(rng.choice(["listening", "searching", "waiting", "complete"])),
            int(rng.choice([1, 5])),
            int(rng.integers(cells)),
            int(rng.integers(1 << 12)) / 16,
        )
        for number in numbers
    )
    searched, closed = (tuple((int(number), some()) for number in numbers[:4]) for _ in range(2))
    found = tuple(
        {int(cell): 1 << int(rng.integers(1, robots)) for cell in rng.integers(0, cells, 9)}.items()
    )
    return Beacon(int(numbers[0]), heartbeats, searched, found, closed)


def joined(beacons):
    """Return what several beacons tell together."""
    sets = [{}, {}, {}]
    for beacon in beacons:
        for known, told in zip(sets, (beacon.searched, beacon.found, beacon.closed), strict=True):
            for number, bits in told:
                known[number] = known.get(number, 0) | bits
    heartbeats = {heartbeat for beacon in beacons for heartbeat in beacon.heartbeats}
    return heartbeats, *sets


@pytest.mark.parametrize("cells", [40, 684, 22_500, 1_000_000])
@pytest.mark.parametrize("most", [64, 200, 1200])
def test_messages_tell_all_in_any_order_and_size(cells, most):
    rng = np.random.default_rng(cells)
    for key in (b"", KEY):
        beacon = random_beacon(rng, cells)
        told = Sender(beacon.sender, key, most).messages(beacon, 5000)
        assert max(map(len, told)) <= most
        receiver = Receiver(key, robots=8, cells=cells, most=most)
        kept = [receiver.open(told[place], 5000) for place in rng.permutation(len(told))[:64]]
        if len(told) <= 64:
            assert joined(kept) == joined([beacon])
        else:
            assert all(
                bits & ~joined([beacon])[1][number] == 0 for number, bits in joined(kept)[1].items()
            )


def test_intervals_against_sets():
    rng = np.random.default_rng(3)
    for size in (1, 5, 60, 400):
        for _ in range(20):
            cells = set(rng.integers(0, size * 3, size).tolist())
            bits = sum(1 << cell for cell in cells)
            found = intervals(bits)
            assert bits_of_intervals(found) == bits
            assert [first + k for first, length in found for k in range(length)] == sorted(cells)
    assert intervals(0) == []


@pytest.mark.parametrize("key", [b"", KEY])
def test_damage_is_noticed_at_every_byte(key):
    beacon = random_beacon(np.random.default_rng(1), 300)
    message = Sender(beacon.sender, key).messages(beacon, 7)[0]
    for place in range(len(message)):
        with pytest.raises(InvalidInputError, match="message: expected"):
            Receiver(key, robots=8, cells=300).open(
                message[:place] + bytes([message[place] ^ 1]) + message[place + 1 :], 7
            )
    for end in range(len(message)):
        with pytest.raises(InvalidInputError, match="message: expected"):
            Receiver(key, robots=8, cells=300).open(message[:end], 7)


def test_random_bytes_are_refused_in_a_sentence_and_take_no_memory():
    rng = np.random.default_rng(2)
    refused = 0
    for _ in range(3000):
        body = bytes(rng.integers(0, 256, rng.integers(0, 40), dtype=np.uint8))
        try:
            decode_beacon(1, body)
        except InvalidInputError:
            refused += 1
    assert 2000 < refused < 3000


@pytest.mark.parametrize("rate", [float("inf"), float("nan"), -1.0, 1e10])
def test_a_rate_is_one_that_a_robot_can_have(rate):
    body = encode_beacon(Beacon(1, (Heartbeat(1, 0, 5, rate, "searching"),)))[0]
    with pytest.raises(InvalidInputError, match="expected a rate"):
        decode_beacon(1, body)
    with pytest.raises(InvalidInputError, match="odd width"):
        decode_beacon(1, encode_beacon(Beacon(1, (Heartbeat(1, 0, 5, 1.0, "searching", 4),)))[0])


def test_cells_and_robots_that_there_are_not_are_refused():
    for beacon in (
        Beacon(1, (), ((1, 1 << 40),)),
        Beacon(1, (), ((9, 1),)),
        Beacon(1, (), (), ((40, 2),)),
        Beacon(1, (), (), ((3, 1 << 9),)),
    ):
        with pytest.raises(InvalidInputError, match="beacon: expected"):
            decode_beacon(1, encode_beacon(beacon)[0], cells=40, robots=9)


def test_without_the_key_nothing_is_believed_and_nothing_twice():
    beacon = Beacon(2, (Heartbeat(2, 1, 0, 1.0, "searching"),), ((2, 3),))
    receiver = Receiver(KEY, robots=3, cells=9)
    sender = Sender(2, KEY)
    first, second = (sender.messages(beacon, 1000)[0] for _ in range(2))
    # overtaken, not lost
    assert receiver.open(second, 1010) == receiver.open(first, 1010) == beacon
    for message in (
        first,
        second,
        Sender(2, b"another one").messages(beacon, 1002)[0],
        Sender(2).messages(beacon, 1003)[0],
    ):
        with pytest.raises(InvalidInputError, match="message: expected"):
            receiver.open(message, 1010)
    for number in (0, 4):
        with pytest.raises(InvalidInputError, match="a robot from 1 to 3"):
            receiver.open(Sender(number, KEY).messages(beacon, 1005)[0], 1010)


def test_a_robot_that_was_restarted_is_heard_and_what_was_recorded_before_is_not():
    beacon = Beacon(2, (Heartbeat(2, 1, 0, 1.0, "searching"),))
    receiver, minute = Receiver(KEY, robots=3, cells=9), 60_000
    recorded = [Sender(2, KEY).messages(beacon, time)[0] for time in range(0, 100 * minute, minute)]
    now = 100 * minute
    assert receiver.open(Sender(2, KEY).messages(beacon, now)[0], now) == beacon
    # a new sender: its clock went on
    assert receiver.open(Sender(2, KEY).messages(beacon, now + 1)[0], now) == beacon
    # and so for a new receiver, that has heard of nothing
    for again in receiver, Receiver(KEY, robots=3, cells=9):
        for message in recorded[:-1]:
            with pytest.raises(InvalidInputError, match="message: expected"):
                again.open(message, now)


def test_a_sender_has_its_share_of_a_second(monkeypatch):
    monkeypatch.setattr("shoal.search.protocol.messages.SHARE", 50)
    receiver, sender = Receiver(KEY, robots=3, cells=9), Sender(1, KEY)
    messages = [sender.messages(Beacon(1, ()), 1000)[0] for _ in range(60)]
    opened = 0
    for message in messages:
        try:
            receiver.open(message, 1500)
            opened += 1
        except InvalidInputError:
            pass
    assert opened == 50
    assert receiver.open(sender.messages(Beacon(1, ()), 2000)[0], 2000) == Beacon(1, ())


def test_all_is_told_within_a_round_of_beacons():
    """Deltas may be lost: who hears one round knows all, wherever it begins."""
    brief = Brief(TourCost(make_tour("comb", (40, 50))), beat=1.0)
    robot, _ = advance(Robot(1, brief, start=0), Begin(0.0))
    checkers = sum(1 << cell for cell in range(0, 2000, 2))
    told = Beacon(
        2, (Heartbeat(2, 1, 1000, 1.0, "searching"),), ((2, checkers),), ((7, 4),), ((2, 2),)
    )
    robot, _ = advance(robot, Heard(0.5, told))
    heard = []
    for beat in range(1, 40):
        robot, actions = advance(robot, Wake(float(beat)))
        heard += [action.beacon for action in actions if isinstance(action, Send)]
    sizes = [sum(map(len, encode_beacon(beacon))) for beacon in heard]
    known = joined(heard[6:24])
    assert known[1][2] == checkers
    assert known[2] == {7: 4}
    assert known[3] == {2: 2}
    assert max(sizes[6:]) < 400 < max(sizes[:6])


def test_uneven_sets_are_told_within_32_beacons():
    """A section ends early where intervals lie densely, so uneven sets need more beacons than even
    ones.
    """
    rng = np.random.default_rng(1)
    for _ in range(30):
        n = int(rng.integers(300, 2000))
        cells = 0
        for first, length, step in zip(
            rng.integers(0, n, 4),
            rng.integers(1, n // 2, 4),
            rng.choice((2, 3, 5, 10), 4),
            strict=True,
        ):
            cells |= sum(
                1 << cell for cell in range(int(first), min(n, int(first + length)), int(step))
            )
        robot, _ = advance(
            Robot(1, Brief(TourCost(make_tour("comb", (1, n))), beat=1.0), start=0), Begin(0.0)
        )
        told = Beacon(2, (Heartbeat(2, 1, n // 2, 1.0, "searching"),), ((2, cells),))
        robot, _ = advance(robot, Heard(0.5, told))
        heard = []
        for beat in range(1, 40):
            robot, actions = advance(robot, Wake(float(beat)))
            heard += [action.beacon for action in actions if isinstance(action, Send)]
        assert len(heard) >= 38
        assert joined(heard[6:38])[1][2] & cells == cells


@pytest.mark.parametrize(
    "network",
    ["perfect", "loss:0.3,delay:2,duplicates:0.3,corruption:0.2,replays:0.5,forgeries:0.5"],
)
def test_short_signed_messages_serve_as_well(network):
    brief = Brief(TourCost(make_tour("moore", (8, 8))))
    plain = SearchWorld(Scenario(brief, (0, 20, 40))).run()
    outcome = SearchWorld(
        Scenario(brief, (0, 20, 40), network=network_of(network), signed=True, packet=64)
    ).run()
    assert outcome.covered == plain.covered
    assert set(outcome.declared) == {1, 2, 3}
    assert outcome.covered_at <= plain.covered_at * (1.0 if network == "perfect" else 1.6)
    assert list(members(outcome.covered)) == list(range(64))


def test_forged_messages_need_a_key():
    brief = Brief(TourCost(make_tour("moore", (4, 4))))
    with pytest.raises(InvalidInputError, match="network: expected a key"):
        Scenario(brief, (0,), network=network_of("forgeries:0.1"))


@pytest.mark.parametrize(
    ("content", "mode", "message"),
    [
        (
            KEY,
            0o644,
            r"key: expected a key that only its owner can read \(chmod 600\), got mode 644",
        ),
        (b"short\n", 0o600, "expected a key of 16 to 4096 bytes, got 5 bytes"),
        (b"x" * 5000, 0o600, "expected a key of 16 to 4096 bytes, got more"),
        (None, 0o600, "expected a readable file with a key"),
    ],
)
def test_bad_keys(content, mode, message, tmp_path):
    path = tmp_path / "key"
    if content is None:
        path.mkdir()
    else:
        path.write_bytes(content)
        path.chmod(mode)
    with pytest.raises(InvalidInputError, match=message):
        read_key(str(path))


def test_a_key_is_read_without_the_end_of_its_line(tmp_path):
    path = tmp_path / "key"
    path.write_bytes(KEY + b"\n")
    path.chmod(0o600)
    assert read_key(str(path)) == KEY
    with pytest.raises(
        InvalidInputError, match="expected a readable file with a key, got the error: No such file"
    ):
        read_key(str(tmp_path / "none"))
