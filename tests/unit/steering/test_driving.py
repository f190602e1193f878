"""Closed-loop steering of rigs, on a physical plant and on small rigs with faults."""

import json

import numpy as np
import pytest

from shoal.core.errors import InvalidInputError, OutputError, RigError
from shoal.steering import SteeringProblem, open_workspace, region
from shoal.steering.contact.world import make_world
from shoal.steering.driving import SteeringDriveError, follow, steer_rig
from shoal.steering.estimation import FrictionEstimate
from shoal.steering.kernels import pressing as kernels
from shoal.steering.planners.sampling import world_of

pytest.importorskip("pymunk")

from shoal.rigs.physics import PlantProperties
from shoal.rigs.steering_plant import SteeringPlant

START, GOAL = [(0.2, 0.3), (0.5, 0.35)], [(0.6, 0.2), (0.7, 0.4)]
ELL = region([(0, 0), (1, 0), (1, 0.5), (0.5, 0.5), (0.5, 1), (0, 1)])
ERRORS = {"own_gain": 0.02, "pulse_error": 0.01, "direction": 1.0, "camera_error": 0.4}


def plant_of(problem, seed=1, **properties):
    about = PlantProperties.of("exact", **(ERRORS | properties))
    return SteeringPlant(problem.place, problem.start, about, np.random.default_rng(seed))


class Bare:
    """A rig with nothing but look and send."""

    def __init__(self, plant, change=lambda points: points):
        self._plant, self._change = plant, change

    def look(self):
        return self._change(self._plant.look())

    def send(self, move):
        self._plant.send(move)


@pytest.mark.parametrize("place", ["square", "disk", ELL])
@pytest.mark.parametrize("friction", [0.5, 10.0])
def test_walls_of_the_plant_stop_and_brake_as_in_the_model(place, friction):
    space = open_workspace(place) if isinstance(place, str) else place
    world, rng = make_world(space, friction=friction), np.random.default_rng(4)
    start = np.array([(0.2, 0.3), (0.3, 0.1)])
    about = PlantProperties.of("exact", friction=friction)
    for _ in range(6):
        plant = SteeringPlant(space, start, about, rng)
        move = rng.normal(scale=0.5, size=2)
        plant.send(move)
        assert plant.points == pytest.approx(world.step(start, move), abs=0.01)


@pytest.mark.parametrize("place", ["square", ELL])
def test_a_drive_arrives_where_a_look_shows_it(place):
    goal = GOAL if place == "square" else [(0.2, 0.7), (0.3, 0.6)]
    problem = SteeringProblem(place, START, goal, friction_at_least=1.0)
    plant = plant_of(problem, friction=1.0, heading=5.0)
    result = steer_rig(problem, Bare(plant))
    assert result, result.reason
    assert (result.status, result.error <= result.problem.tolerance) == ("arrived", True)
    away = np.linalg.norm(plant.points - result.goal, axis=1).max()
    assert away <= 1.2 * result.problem.tolerance
    assert result.moves == plant.moves == len(result.seen) - 1
    assert result.estimates["angle"] == pytest.approx([plant.heading] * 2, abs=2.0)
    assert not result.estimates["slips"]
    json.dumps(result.report())


def test_friction_that_is_less_than_stated_is_named():
    # goals that no plan reaches with friction .5
    problem = SteeringProblem("square", START, [(0.1, 0.1), (0.9, 0.9)], friction_at_least=3.0)
    result = steer_rig(problem, plant_of(problem, friction=0.5))
    assert result.status in ("slipping", "unreachable")
    assert "the walls slip more than was stated" in result.reason
    assert result.estimates["friction"] == pytest.approx(0.5, abs=0.15)


def test_particles_that_change_places_in_the_picture_or_have_ghosts_are_followed():
    problem = SteeringProblem("square", START, GOAL, friction_at_least=1.0)
    rng = np.random.default_rng(5)

    def shuffled(points):
        extra = rng.uniform(0, 1, (int(rng.integers(2)), 2))
        return np.vstack([points[rng.permutation(2)], extra])

    rig = Bare(plant_of(problem, friction=1.0), shuffled)
    first = rig._plant.look()
    rig.look_again, looks = rig.look, [first] * 3
    rig.look = lambda: looks.pop() if looks else rig.look_again()
    assert steer_rig(problem, rig)


def test_particles_that_meet_keep_the_order_of_the_rig():
    """Where nothing tells them apart, the drive says so."""
    start = [(0.3, 0.3), (0.303, 0.3)]
    problem = SteeringProblem("square", start, np.array(start) + 0.3, friction_at_least=1.0)
    plant = plant_of(problem, friction=1.0, own_gain=0.0)
    result = steer_rig(problem, plant)
    assert result
    assert "so near to each other" in result.reason
    away = np.linalg.norm(plant.points - result.goal, axis=1).max()
    assert away <= result.problem.tolerance


def test_one_look_that_errs_ends_no_drive():
    problem = SteeringProblem("square", START, GOAL, friction_at_least=1.0, max_moves=5)
    plant = plant_of(problem, friction=1.0)
    rig, looks = Bare(plant), []

    def look():
        looks.append(plant.moves)
        return np.array(GOAL) if len(looks) == 4 else plant.look()

    rig.look = look
    result = steer_rig(problem, rig)
    assert result.moves > 1
    away = np.linalg.norm(plant.points - result.goal, axis=1).max()
    assert not result or away <= result.problem.tolerance


def test_looks_that_are_all_the_same_do_not_show_a_camera_without_errors():
    problem = SteeringProblem("square", START, GOAL, friction_at_least=1.0)
    plant = plant_of(problem, friction=1.0, camera_error=0.0)
    problem = problem.replaced(max_moves=1)
    assert steer_rig(problem, plant).estimates["look_error"] == pytest.approx(2e-4)


def test_many_presses_near_the_limit_arrive():
    """On a disk, the goals are far apart, and one wrong press brings the particles together."""
    start, goal = SteeringProblem("disk").endpoints(2)
    problem = SteeringProblem("disk", start, goal, friction_at_least=9.0, max_moves=300)
    about = PlantProperties.of("exact", **ERRORS, friction=10.0)
    plant = SteeringPlant(problem.place, start, about, np.random.default_rng([2, 1]))
    result = steer_rig(problem, plant, seed=2)
    assert result, result.reason
    assert np.linalg.norm(plant.points - result.goal, axis=1).max() <= result.problem.tolerance


def presses_learnt(stated, truth, rng, presses=8):
    """Return what is learnt of the friction from presses into a wall that slips at ``truth``."""
    estimate, gains = FrictionEstimate(stated), np.tile([1.0, 0.0], (2, 1))
    own = world_of(make_world(open_workspace("square")))._replace(flat=True)
    move, spare = np.empty(2), np.empty(2)
    for _ in range(presses):
        before = np.array([[0.3, 0.0], [0.4, 0.3]])
        sent = rng.uniform(0.1, 0.2) * np.array([rng.uniform(0, 4), -1.0])
        seen = before.copy()
        made = sent * (1 + 0.01 * rng.normal(size=2))
        kernels.send_both(seen, *made, gains, kernels.with_friction(own, truth), move, spare)
        seen += rng.normal(scale=5e-4, size=seen.shape)
        estimate.learn(before, sent, seen, gains, own, error=5e-4, deviation=0.013)
    return estimate


@pytest.mark.parametrize(
    ("stated", "slips", "holds"),
    [(1.0, False, False), (0.9, False, False), (0.5, False, True), (2.0, True, False)],
)
def test_a_wrong_statement_of_friction_is_named_and_a_true_one_is_not(stated, slips, holds):
    rng = np.random.default_rng(7)
    learnt = [presses_learnt(stated, 1.0, rng) for _ in range(20)]
    assert {one.slips for one in learnt} == {slips}
    assert {one.holds for one in learnt} == {holds}
    assert all(0.8 <= one.best <= 1.25 for one in learnt)


def test_an_understated_friction_is_learnt_and_named():
    problem = SteeringProblem("square", START, GOAL, friction_at_least=0.7)
    result = steer_rig(problem, plant_of(problem, friction=10.0))
    assert result, result.reason
    assert result.estimates["holds"]
    assert "the walls hold more than was stated" in result.reason


def test_a_drive_learns_the_gains_before_it_touches_a_wall():
    """Where the particles are near to each other, a press that errs cannot be taken back."""
    start = [(0.25, 0.41), (0.34, 0.43)]
    problem = SteeringProblem("square", start, GOAL, friction_at_least=1.35, max_moves=1)
    plant = plant_of(problem, friction=1.5)
    result = steer_rig(problem, plant)
    assert plant.points[1] - plant.points[0] == pytest.approx(np.subtract(*start[::-1]), abs=0.01)
    learnt = np.linalg.norm(result.seen[1] - result.seen[0], axis=1) / np.hypot(*result.inputs[0])
    assert result.estimates["gain"] == pytest.approx(learnt, abs=0.05)


def test_the_friction_that_is_stated_is_mostly_believed():
    stated = FrictionEstimate(2.0)
    assert stated.least(2.0) == pytest.approx(0.95)
    assert (stated.quantile(0.1), stated.slips) == (2.0, False)
    assert FrictionEstimate(np.inf, 0.5).least(1e8) == pytest.approx(0.5)


def test_a_field_that_is_off_is_an_alarm():
    problem = SteeringProblem("square", START, GOAL)
    rig = Bare(plant_of(problem))
    rig.send = lambda move: None
    result = steer_rig(problem, rig)
    assert (result.status, bool(result)) == ("alarm", False)
    assert "followed" in result.reason


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ([[-1, 0], [0, 1]], "left and right are exchanged"),
        ([[1, 0], [0, -1]], "up and down are exchanged"),
        ([[0, 1], [1, 0]], "x and y exchanged"),
        ([[0, 0], [0, 1]], "x: a coil does nothing"),
        ([[0, 0], [0, 0]], "frozen"),
        ([[0.5, 0], [0, 0.5]], "the particles move only by 0.5"),
        ([[1, 0], [0, 1]], None),
    ],
)
def test_what_is_wrong_with_the_field_is_named_early(change, word):
    class Wrong(Bare):
        def send(self, move):
            self._plant.send(np.array(change) @ move)

    problem = SteeringProblem("square", START, GOAL, friction_at_least=1.8)
    plant = plant_of(problem, friction=2.0)
    still = plant.look()
    rig = Wrong(plant, (lambda seen: still) if word == "frozen" else (lambda seen: seen))
    result = steer_rig(problem, rig)
    if word is None or "only" in word:
        assert result.status == "arrived"
        assert (word or "") in result.reason
        assert ("only" in result.reason) == (word is not None)
    else:
        assert (result.status, result.moves <= 10) == ("alarm", True)
        assert word in result.reason


def test_a_half_of_a_coil_that_dies_is_named():
    class Half(Bare):
        def send(self, move):
            self._plant.send(np.array([max(move[0], 0.0), move[1]]))

    problem = SteeringProblem("square", START, [(0.2, 0.2), (0.3, 0.4)], friction_at_least=1.8)
    result = steer_rig(problem, Half(plant_of(problem, friction=2.0)))
    assert result.status == "alarm"
    assert "x: a coil does nothing" in result.reason
    assert result.moves <= 10


def test_what_a_rig_may_not_do():
    problem = SteeringProblem("square", START, GOAL)
    with pytest.raises(InvalidInputError, match="look"):
        steer_rig(problem, object())
    with pytest.raises(InvalidInputError, match="inside the workspace"):
        steer_rig(problem, Bare(plant_of(problem), lambda points: 300 * points))
    with pytest.raises(RigError, match="finite positions"):
        steer_rig(problem, Bare(plant_of(problem), lambda points: points * np.nan))
    rig = Bare(plant_of(problem))

    def cut(move):
        raise RigError("the cable is out")

    rig.send = cut
    with pytest.raises(SteeringDriveError, match="cable") as error:
        steer_rig(problem, rig)
    assert error.value.drive.moves == 0


def test_a_log_has_every_input_and_is_never_overwritten(tmp_path):
    problem = SteeringProblem("square", START, GOAL, friction_at_least=1.0)
    log = tmp_path / "log.jsonl"
    result = steer_rig(problem, plant_of(problem, friction=1.0), log=log)
    lines = [json.loads(line) for line in log.read_text().splitlines()]
    assert [line["input"] for line in lines if "input" in line] == result.inputs.tolist()
    assert lines[-1]["end"] == "arrived"
    with pytest.raises(OutputError, match="exists already"):
        steer_rig(problem, plant_of(problem), log=log)


def test_one_particle_follows_way_points_around_an_obstacle():
    place = region(
        [(0, 0), (1, 0), (1, 1), (0, 1)], [[(0.4, 0.4), (0.6, 0.4), (0.6, 0.6), (0.4, 0.6)]]
    )
    problem = SteeringProblem(place, [(0.1, 0.1), (0.2, 0.5)], GOAL)
    plant = plant_of(problem, heading=10.0, own_gain=0.1)
    points = [(0.8, 0.5), (0.5, 0.8), (0.3, 0.5)]
    result = follow(problem, Bare(plant), points, particle=2)
    assert result, result.reason
    assert result.estimates["waypoints_reached"] == 3
    assert result.goal.tolist() == [[0.3, 0.5]]
    path = result.seen[:, 0]
    for point in points:
        assert np.linalg.norm(path - point, axis=1).min() <= result.problem.tolerance
    assert 0 < result.estimates["largest_deviation"] < 0.1 * place.size
    assert np.linalg.norm(plant.points[1] - points[-1]) <= 1.2 * result.problem.tolerance
    with pytest.raises(InvalidInputError, match="waypoints"):
        follow(problem, Bare(plant), [(0.5, 0.5)])
    assert not follow(problem.replaced(max_moves=2), Bare(plant), points)
