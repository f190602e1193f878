"""The numbers of the protocol, which its plain and its compiled form share."""

from __future__ import annotations

# beacons
HELLOS = 8  # minimum number of beacons that a robot sends during the time ``Brief.hello``
REPEATED = 4  # number of beacons that repeat a new fact
# a beacon repeats at most 1/16 of all facts, and at most 1/4 if the robot will soon be silent
ROUND, LAST_ROUND = 16, 4
LEAST, MOST = 8, 1000  # minimum and maximum number of intervals of known facts per beacon
# minimum number of other robots' heartbeats per beacon; for more than 24 other robots, a beacon has
# a quarter, up to the maximum number
RELAYED, MOST_RELAYED = 6, 24
NEWS = 32  # maximum number of other robots whose new facts a beacon tells
LAG_UNIT = 1 / 16
LINGER = 12  # number of beacons that a robot sends after the search is complete

# messages
PIECE = 32  # maximum bytes of intervals in a byte string, which must fit into the shortest message
FULL_PIECE = PIECE - 10  # bytes after which a byte string gets no further interval
SHARE = 1000  # maximum number of messages per sender and second
REMEMBERED = 64  # number of stamps that a receiver remembers for each sender
RECORDED = 1000  # number of recorded messages for replay attacks
STAMPS_APART = (
    100_000  # maximum difference between a message's stamp and the clock, in a simulation
)

# decisions
ARRIVAL = 2.0  # beacon periods until the news of the last searched cell has arrived
AVOIDED = 3.0  # cells: time for which a robot avoids a cell in which it met another robot
# cells: cost of the way from the centre of a cell to an obstacle in the next cell, and back
LOOK = 1.0
WORTH = 1.0  # a robot helps only if it saves more than the time for this number of cells

# a waiting robot that knows more than so many others decides about so often per beacon period, and
# otherwise whenever it hears a message
DECISIONS = 64

# beliefs
FALSE_POSITIVE_RATE = 0.01  # false-positive rate of the failure detector
MARK = 8.0  # beacon periods: minimum observation time for estimating a robot's speed
# tolerated lag: fraction of the elapsed time, plus number of beacon periods
TOLERATED, BEATS = 0.25, 4.0
# tolerated lag of the robot itself, divided by the tolerated lag of another robot
RELUCTANCE = 1.4
CRAWL = 1e-3  # lower bound of a robot's estimated speed, divided by its declared speed
# beacon periods: minimum and maximum silence after which a robot is presumed dead
SHORTEST_SILENCE, LONGEST_SILENCE = 3.0, 40.0

# the simulated world
TRIES = 8  # number of attempts to enter an occupied cell before a robot goes elsewhere
# time between two attempts, in units of the time in which a robot of speed 1 searches one cell
RETRY = 0.25
