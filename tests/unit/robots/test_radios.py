"""Radios of robots: UDP on the address that was named, and serial lines that break bytes."""

from __future__ import annotations

import os
import random
import re
import socket
import threading
from contextlib import suppress
from pathlib import Path

import pytest
from benchmarks.serial_radio import Bus
from hypothesis import given
from hypothesis import strategies as st

from shoal import InvalidInputError
from shoal.robots import radios
from shoal.robots.companion import Companion, journal_path
from shoal.robots.journal import Journal
from shoal.robots.radios import (
    LONGEST_FRAME,
    PARITY,
    SerialRadio,
    decode_frame,
    encode_frame,
    open_radio,
)
from shoal.robots.tasks import read_task, write_task
from shoal.search import SearchProblem
from shoal.search.run import run
from shoal.testing import check_radio

pytest.importorskip("serial")
pytest.importorskip("reedsolo")


class Carried:
    """A serial radio that is joined to another by a pseudo-terminal, whose bytes are carried
    whenever somebody looks.
    """

    most, rate, fault = radios.SHORTEST, 1e4, ""

    def __init__(self):
        self.hub, end = os.openpty()
        self.radio = SerialRadio(os.ttyname(end), 115200, duty=1.0)
        os.close(end)
        os.set_blocking(self.hub, False)
        self.broadcast = self.radio.broadcast

    def fileno(self):
        self.carry()
        return self.radio.fileno()

    def carry(self):
        for one, to in ((self, self.other), (self.other, self)):
            with suppress(BlockingIOError):
                os.write(to.hub, os.read(one.hub, 4096))

    def receive(self):
        self.carry()
        return self.radio.receive()

    def close(self):
        self.radio.close()
        os.close(self.hub)


def test_serial_radios_hear_each_other():
    one, other = Carried(), Carried()
    one.other, other.other = other, one
    check_radio(one, other, tries=30, seconds=0.01)
    one.close()
    other.close()


def free_port(host="127.0.0.1"):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind((host, 0))
        return probe.getsockname()[1]


def test_radios_hear_each_other_on_addresses_of_their_own():
    ports = free_port("127.0.0.2"), free_port("127.0.0.3")
    one = open_radio(f"udp:127.0.0.2:{ports[0]},127.0.0.3:{ports[1]}")
    other = open_radio(f"udp:127.0.0.3:{ports[1]},127.0.0.2:{ports[0]}")
    try:
        check_radio(one, other)
    finally:
        one.close()
        other.close()


@pytest.mark.parametrize("group", ["239.83.72.77", "127.255.255.255"])
def test_radios_hear_each_other_in_a_group_or_by_broadcast_on_one_interface(group):
    port = free_port()
    pair = [open_radio(f"udp:lo:{free_port()},{group}:{port}") for _ in range(2)]
    try:
        check_radio(*pair)
    finally:
        for radio in pair:
            radio.close()


def test_nothing_listens_beyond_the_address_that_was_named():
    port = free_port("127.0.0.2")
    radio = open_radio(f"udp:127.0.0.2:{port},127.0.0.3:9")
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as elsewhere:
            elsewhere.bind(("127.0.0.4", port))  # the same port is free on each other address
            elsewhere.sendto(b"for another address", ("127.0.0.4", port))
        assert radio.receive() is None
        sockets = Path("/proc/net/udp").read_text()
        held = re.findall(r"^\s*\d+: (\w{8}):(\w{4})", sockets, re.MULTILINE)
        assert ("0200007F", f"{port:04X}") in held
        assert ("00000000", f"{port:04X}") not in held
    finally:
        radio.close()


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("udp:0.0.0.0:9000,127.0.0.1:9001", "which means all"),
        ("udp:127.0.0.1:9000", "addresses of other robots"),
        ("udp:127.0.0.1:9000,127.0.0.1:9001,127.0.0.1:9000", "got the own one again"),
        ("udp:127.0.0.1:70000,127.0.0.1:1", "expected udp:HOST:PORT"),
        ("udp:192.0.2.1:9000,127.0.0.1:9001", "an address of this computer"),
        ("udp:127.0.0.1:9000,239.1.1.1:9000,127.0.0.1:9001", "alone"),
        ("serial:/dev/nothing,9600", "serial line that opens"),
        ("serial:/dev/ttyS0@9600,duty=2", "expected udp:HOST:PORT"),
        ("serial:/dev/null,9600", "serial line that opens"),
        ("serial:/dev/nothing,9600,duty=0.0", "a duty above 0"),
        ("smoke:hill", "expected udp:HOST:PORT"),
    ],
)
def test_other_radios_are_refused(text, expected):
    with pytest.raises(InvalidInputError, match=re.escape(expected)):
        open_radio(text)


@given(message=st.binary(min_size=1, max_size=64), data=st.data())
def test_a_frame_is_repaired_unless_too_much_is_broken(message, data):
    frame = encode_frame(message)
    assert frame[0] == frame[-1] == 0
    assert 0 not in frame[1:-1]
    inside = bytearray(frame[1:-1])
    places = data.draw(st.lists(st.integers(0, len(inside) - 1), max_size=len(inside), unique=True))
    for place in places:
        inside[place] = data.draw(st.integers(1, 255))
    # a broken length of a piece misplaces two zeros
    if len(places) <= PARITY // 6:
        assert decode_frame(bytes(inside)) == message
    else:
        assert decode_frame(bytes(inside)) in (message, None)


@given(noise=st.binary(max_size=300))
def test_noise_is_no_message(noise):
    assert decode_frame(noise.replace(b"\0", b"")) is None


def test_most_messages_arrive_where_a_twentieth_of_all_bytes_is_broken():
    chance = random.Random(1)
    sent = [chance.randbytes(chance.randrange(20, 65)) for _ in range(300)]
    stream = bytearray(b"".join(map(encode_frame, sent)))
    for place in range(len(stream)):
        if chance.random() < 0.05:
            stream[place] = chance.randrange(256)
    came = [decode_frame(frame) for frame in bytes(stream).split(b"\0") if frame]
    whole = [message for message in came if message is not None]
    assert len(whole) >= 0.95 * len(sent)
    assert set(whole) <= set(sent)


def test_a_serial_radio_keeps_its_duty_cycle_and_gives_up_messages(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(radios.time, "monotonic", lambda: now[0])
    hub, end = os.openpty()
    os.set_blocking(hub, False)
    radio = SerialRadio(os.ttyname(end), 9600, duty=0.1)
    try:
        given_up = sum(radio.broadcast(bytes([number]) * 64) for number in range(40))
        assert given_up == radio.overdue == 40 - 16  # as many wait
        sent = 0
        for _ in range(1000):  # 100 s
            now[0] += 0.1
            radio.broadcast(bytes(64))
            radio.receive()
            with suppress(BlockingIOError):
                sent += len(os.read(hub, 4096))
        assert 9600 - 2 * LONGEST_FRAME <= sent == radio.bytes_sent <= 9600
        for _ in range(10_000):  # nobody reads, and then the line takes no more
            now[0] += 0.1
            radio.broadcast(bytes(64))
        assert radio.fault.startswith("radio: the serial line cannot be written")
    finally:
        radio.close()
        os.close(hub)
        os.close(end)


def test_robots_search_over_a_serial_line_that_breaks_bytes(tmp_path):
    """Four robots; 9600 baud in a twentieth of the time."""
    faster, duty = 20.0, 0.15
    problem = SearchProblem(region="rectangle:40x30", robots=4, footprint=10)
    write_task(run(problem, seed=1), tmp_path)
    task, bus = read_task(tmp_path), Bus(4, rate=960 * faster, broken=0.05)
    results = {}

    def search(number):
        radio = SerialRadio(bus.paths[number - 1], int(9600 * faster), duty=duty)
        journal = Journal(journal_path(tmp_path, number), task.search, number)
        results[number] = Companion(task, number, radio, journal, speed_up=faster).run()
        radio.close()
        journal.close()

    robots = [
        threading.Thread(target=search, args=(number,), daemon=True) for number in (1, 2, 3, 4)
    ]
    for robot in robots:
        robot.start()
    for robot in robots:
        robot.join(60)
    bus.close()
    assert sorted(results) == [1, 2, 3, 4]
    assert all(result.complete and not result.fault for result in results.values())
    assert sum(result.searched for result in results.values()) >= len(task.cells)
