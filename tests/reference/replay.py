"""Replay of steering plans in an arithmetic of its own, written from the rules of motion alone.

Nothing of Shoal is used: a plan is judged by the JSON form of its workspace, its start and its
inputs. The rules are those of paper W, section III, as corrected: a particle within the contact
tolerance of a wall with the inward normal N is held while N·u <= 1e-9 |u|, and otherwise moves
until it meets a wall. The contact tolerance and the bound 1e-9 are parameters, and the whole scene
can be turned, scaled and shifted before the replay, so that every number of it is another one.
"""

from __future__ import annotations

from math import cos, hypot, inf, pi, sin, sqrt

LEAVING = 1e-9  # share of a move: what leads off a wall by less is held


def dot(one, other):
    return sum(a * b for a, b in zip(one, other, strict=True))


def plus(one, factor, other):
    return tuple(a + factor * b for a, b in zip(one, other, strict=True))


def length_of(vector):
    return sqrt(dot(vector, vector))


# -------------------------------------------------------------------------------------------------
# scene


class Turned:
    """A turn about the origin, a scale and a shift of the first two coordinates; heights are only
    scaled.
    """

    def __init__(self, turn=0.0, scale=1.0, shift=(0.0, 0.0)):
        self.cos, self.sin, self.scale, self.shift = cos(turn), sin(turn), scale, shift

    def move(self, vector):
        x, y, *rest = vector
        return (
            self.scale * (self.cos * x - self.sin * y),
            self.scale * (self.sin * x + self.cos * y),
            *(self.scale * z for z in rest),
        )

    def point(self, place):
        x, y, *rest = self.move(place)
        return x + self.shift[0], y + self.shift[1], *rest


def corners_of(workspace):
    if workspace["type"] == "regular":
        sides, radius = workspace["sides"], workspace.get("radius", 0.5)
        angles = [-pi / 2 + pi / sides + 2 * pi * k / sides for k in range(sides)]
        return [(radius * cos(a), radius * sin(a)) for a in angles]
    return [tuple(corner) for corner in workspace["vertices"]]


def with_free_side_left(ring, *, counter_clockwise):
    twice = sum(
        ax * by - bx * ay for (ax, ay), (bx, by) in zip(ring, [*ring[1:], ring[0]], strict=True)
    )
    return ring if (twice > 0) == counter_clockwise else ring[::-1]


class Scene:
    """The walls of a workspace: half spaces and a circle, or, around obstacles, segments."""

    def __init__(self, workspace, turned, radius=0.0, leaving=LEAVING):
        self.leaving = leaving
        self.planes, self.circle, self.segments, self.reflex = [], None, [], {}
        base = workspace.get("base", workspace) if workspace["type"] == "prism" else workspace
        radius *= turned.scale
        if workspace["type"] == "region":
            rings = [
                with_free_side_left(
                    [tuple(p) for p in workspace["outline"]], counter_clockwise=True
                )
            ]
            rings += [
                with_free_side_left([tuple(p) for p in ring], counter_clockwise=False)
                for ring in workspace.get("obstacles", [])
            ]
            for ring in rings:
                self.add_ring([turned.point(corner) for corner in ring])
            xs, ys = zip(*rings[0], strict=True)
        elif "radius" in base and base["type"] in ("disk", "cylinder"):
            middle = tuple(base.get("center", (0.0, 0.0)))
            self.circle = (turned.point(middle), turned.scale * base["radius"] - radius)
            xs, ys = (0.0, 2 * base["radius"]), (0.0, 2 * base["radius"])
        else:
            ring = with_free_side_left(corners_of(base), counter_clockwise=True)
            xs, ys = zip(*ring, strict=True)
            here = [turned.point(corner) for corner in ring]
            for (ax, ay), (bx, by) in zip(here, [*here[1:], here[0]], strict=True):
                long = hypot(bx - ax, by - ay)
                nx, ny = (ay - by) / long, (bx - ax) / long
                self.planes.append(((nx, ny), nx * ax + ny * ay + radius))
        if "height" in workspace:
            self.planes = [((nx, ny, 0.0), offset) for (nx, ny), offset in self.planes]
            if not workspace.get("open_ends", False):
                self.planes += [
                    ((0.0, 0.0, 1.0), 0.0),
                    ((0.0, 0.0, -1.0), -turned.scale * workspace["height"]),
                ]
        self.size = turned.scale * (
            max(max(xs) - min(xs), max(ys) - min(ys)) - 2 * radius / turned.scale
        )

    def add_ring(self, ring):
        first, count = len(self.segments), len(ring)
        for k in range(count):
            (ax, ay), (bx, by) = ring[k], ring[(k + 1) % count]
            long = hypot(bx - ax, by - ay)
            self.segments.append(
                (
                    (ax, ay),
                    ((bx - ax) / long, (by - ay) / long),
                    ((ay - by) / long, (bx - ax) / long),
                    long,
                )
            )
        for k in range(count):
            before, after = first + (k - 1) % count, first + k
            (ux, uy), (vx, vy) = self.segments[before][1], self.segments[after][1]
            # more than half a turn of free space at the beginning of ``after``
            if ux * vy - uy * vx < 0:
                self.reflex[after] = before

    def touching(self, place, near):
        """The inward normals of the half spaces and the circle within ``near`` of a place."""
        normals = [normal for normal, offset in self.planes if dot(normal, place) - offset <= near]
        if self.circle is not None:
            (cx, cy), radius = self.circle
            away = hypot(place[0] - cx, place[1] - cy)
            if radius - away <= near:
                normals.append(
                    ((cx - place[0]) / away, (cy - place[1]) / away, *[0.0] * (len(place) - 2))
                )
        return normals

    def meeting(self, place, way):
        """The share of ``way`` after which a place inside meets a half space or the circle, or
        infinity.
        """
        first = inf
        for normal, offset in self.planes:
            speed = dot(normal, way)
            if speed < -LEAVING * length_of(way):
                first = min(first, max(dot(normal, place) - offset, 0.0) / -speed)
        if self.circle is not None:
            (cx, cy), radius = self.circle
            x, y, a = place[0] - cx, place[1] - cy, way[0] ** 2 + way[1] ** 2
            if a > 0:
                half = x * way[0] + y * way[1]
                under = half * half - a * min(x * x + y * y - radius * radius, 0.0)
                first = min(first, (-half + sqrt(under)) / a)
        return first

    # ------------------------------------------------------------------------------ around
    # obstacles

    def pushes(self, segment, way):
        return dot(self.segments[segment][2], way) <= self.leaving * length_of(way)

    def near_segment(self, segment, place, near):
        corner, along, normal, long = self.segments[segment]
        off = plus(place, -1, corner)
        on, away = dot(along, off), dot(normal, off)
        return hypot(away, max(-on, on - long, 0.0)) <= near

    def holds(self, place, way, near):
        """Whether segments hold a particle: one alone, or at a corner that sticks out both
        together.
        """
        touched = {k for k in range(len(self.segments)) if self.near_segment(k, place, near)}
        released = set()
        for after, before in self.reflex.items():
            if (
                after in touched
                and before in touched
                and not (self.pushes(after, way) and self.pushes(before, way))
            ):
                released |= {after, before}
        return any(self.pushes(k, way) for k in touched - released)

    def first_segment(self, place, way, near):
        """The share of ``way`` after which a place meets the free side of a segment."""
        first = inf
        for k, (corner, along, normal, long) in enumerate(self.segments):
            speed = dot(normal, way)
            away = dot(normal, plus(place, -1, corner))
            if speed >= 0 or away < -near or self.near_segment(k, place, near):
                continue
            share = max(away / -speed, 0.0)
            on = dot(along, plus(plus(place, share, way), -1, corner))
            if -1e-12 * self.size <= on <= long + 1e-12 * self.size:
                first = min(first, share)
        return first


# ------------------------------------------------------------------------------------------------
# motion


def moved(scene, place, move, near, friction=inf):
    """Where one particle is after a move, and the share of the move after which a wall stopped it
    first.
    """
    if not any(move):
        return place, 1.0
    if scene.segments:
        if scene.holds(place, move, near):
            return place, 0.0
        share = min(1.0, scene.first_segment(place, move, near))
        return plus(place, share, move), share
    if friction < inf:
        return slid(scene, place, move, near, friction), 1.0
    if any(
        dot(normal, move) <= scene.leaving * length_of(move)
        for normal in scene.touching(place, near)
    ):
        return place, 0.0
    share = min(1.0, scene.meeting(place, move))
    return plus(place, share, move), share


def slid(scene, place, move, near, friction):
    """Where a particle that may slide along walls is after a move."""
    left, least = 1.0, LEAVING * length_of(move)
    while left > 0:
        on = scene.touching(place, near)
        pushing = [n for n in on if dot(n, move) <= scene.leaving * length_of(move)]
        velocity, along = (tuple(move), None) if not pushing else (None, None)
        for normal in pushing:
            push = max(-dot(normal, move), 0.0)
            flat = plus(move, -dot(normal, move), normal)
            speed = length_of(flat) - friction * push
            if speed <= least:
                continue
            candidate = tuple(speed / length_of(flat) * part for part in flat)
            if all(dot(other, candidate) >= -least for other in on if other is not normal):
                velocity, along = candidate, normal
                break
        if velocity is None:
            return place
        share = min(
            left,
            scene.meeting_but(place, velocity, along)
            if along is not None
            else scene.meeting(place, velocity),
        )
        on_circle = (
            along is not None
            and scene.circle is not None
            and all(normal != along for normal, _ in scene.planes)
        )
        if on_circle:
            share = min(share, scene.circle[1] / 2000 / length_of(velocity))
        place = plus(place, share, velocity)
        if on_circle:
            (cx, cy), radius = scene.circle
            factor = radius / hypot(place[0] - cx, place[1] - cy)
            place = (cx + factor * (place[0] - cx), cy + factor * (place[1] - cy), *place[2:])
        left -= share
    return place


def _meeting_but(scene, place, velocity, along):
    """`Scene.meeting` without the wall along which a particle slides."""
    if scene.circle is not None and not scene.planes:
        return inf
    others = Scene.__new__(Scene)
    others.planes = [plane for plane in scene.planes if plane[0] != along]
    others.circle = scene.circle if any(plane[0] == along for plane in scene.planes) else None
    return Scene.meeting(others, place, velocity)


Scene.meeting_but = _meeting_but


def collided(before, move, shares, apart):
    """The shares of a move after which balls stop that may also meet balls that have stopped; walls
    alone give ``shares``.
    """
    shares = list(shares)
    while True:
        earliest, who = inf, None
        for mover in range(len(before)):
            for other in range(len(before)):
                if shares[other] >= shares[mover]:
                    continue
                gap = plus(before[mover], -1, plus(before[other], shares[other], move))
                a, half, rest = dot(move, move), dot(gap, move), dot(gap, gap) - apart * apart
                under = half * half - a * rest
                if half >= 0 or under < 0:
                    continue
                when = max((-half - sqrt(under)) / a, shares[other])
                if when < min(shares[mover], earliest):
                    earliest, who = when, mover
        if who is None:
            return shares
        shares[who] = earliest


def end_of(
    workspace,
    start,
    moves,
    *,
    touch=1e-9,
    turned=None,
    friction=inf,
    radius=0.0,
    leaving=LEAVING,
):
    """Return where the particles are after a plan, in the turned scene; ``touch`` is relative to
    the size of the workspace, and ``leaving`` to a move.
    """
    turned = Turned() if turned is None else turned
    scene = Scene(workspace, turned, radius, leaving)
    places = [turned.point(place) for place in start]
    for vector in moves:
        move = turned.move(vector)
        after = [moved(scene, place, move, touch * scene.size, friction) for place in places]
        if radius and any(move):
            shares = collided(
                places, move, [share for _, share in after], 2 * radius * turned.scale
            )
            after = [
                (plus(place, share, move), share)
                for place, share in zip(places, shares, strict=True)
            ]
        places = [place for place, _ in after]
    return places


def error_of(workspace, start, goal, moves, *, turned=None, **rules):
    """Return how far from its goal the farther particle is after a plan, in the unit of the
    workspace itself.
    """
    turned = Turned() if turned is None else turned
    ends = end_of(workspace, start, moves, turned=turned, **rules)
    return max(
        length_of(plus(end, -1, turned.point(place))) / turned.scale
        for end, place in zip(ends, goal, strict=True)
    )
