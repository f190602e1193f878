"""The parallel environment of searches: PettingZoo's own checks for every option, times, messages,
deaths, errors.
"""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from pettingzoo.test import api_test, parallel_api_test, parallel_seed_test, state_test

import shoal
import shoal.envs
from shoal.envs import SearchEnv, search_v0
from shoal.envs.options import OptionError
from shoal.search import SearchProblem

SMALL = {"region": "square:50", "robots": 4, "max_cycles": 40}
VARIANTS = {
    "direction": {},
    "cell": {"action": "cell"},
    "lossy": {"loss": 0.5, "network": "range:3,delay:0.5"},
    "crashes": {"crashes": 2},
    "faults": {"faults": ["crash:1@3", "pause:2@2:6", "slow:3@1:2", "liar:4"]},
    "rates": {"rates": (1, 2, 1, 1), "reward": "own"},
    "footprints": {"footprint": (10, 10, 30, 10)},
    "energy": {"vehicle": "ideal,endurance=1.5,reserve=0.1,recharge=0.1"},
    "multiplicity": {"multiplicity": 2},
    "obstacles": {"obstacles": 3},
    "obstacles-cell": {"obstacles": 3, "action": "cell"},
    "ring": {"region": "ring:60x30"},
    "targets": {"targets": 3, "false_alarm": 0.1},
    "prior": {"prior": ["ring:20,30:0.5=15"], "targets": 2, "detection": 0.7, "found_reward": 5},
    "moving": {"prior": ["ring:20,30:0.5=15"], "targets": 1, "target_moves": 0.5, "until": "found"},
    "wrong-position": {"faults": ["wrong-position:1:2"]},
    "image": {"observation": "image", "faults": ["crash:1@3"]},
    "flat": {"observation": "flat", "obstacles": 3},
}
WAIT, HERE, LEFT, UP, RIGHT, DOWN = range(6)


@pytest.mark.parametrize("variant", VARIANTS)
def test_pettingzoos_own_checks_pass(variant, capsys):
    options = SMALL | VARIANTS[variant]
    env = search_v0.parallel_env(**options)
    parallel_api_test(env, num_cycles=40)
    parallel_seed_test(lambda: search_v0.parallel_env(**options), num_cycles=10)
    observations, _ = env.reset(seed=1)
    while env.agents:
        observations, *_ = env.step(
            {agent: env.action_space(agent).sample() for agent in env.agents}
        )
        for agent, observation in observations.items():
            assert env.observation_space(agent).contains(observation)


@pytest.mark.parametrize("options", [{}, {"targets": 3, "obstacles": 3}])
def test_pettingzoos_own_checks_of_the_state_pass(options):
    env = search_v0.parallel_env(**SMALL | options)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.state()
    state_test(search_v0.env(**SMALL | options), env)


def test_the_state_is_what_is_true():
    env = corridor(faults=["crash:2@2.5"], loss=1.0, max_cycles=10)
    env.reset(seed=1)
    walk(env, [{"robot_1": HERE, "robot_2": HERE}, {"robot_1": RIGHT}, {}])
    state = env.state()
    assert env.state_space.contains(state)
    planes = dict(zip(search_v0.STATE_PLANES, state[:24].reshape(4, 6).tolist(), strict=True))
    assert planes["region"] == [1] * 6
    assert planes["searched"] == [1, 1, 0, 0, 0, 1]
    assert planes["obstacles"] == planes["targets"] == [0] * 6
    assert state[24:].tolist() == pytest.approx([1, 0, 0.2, 1, 0, 0, 1, 1, 0.3])


@pytest.mark.filterwarnings("ignore:Observation")  # PettingZoo would rather have one array
def test_pettingzoos_own_checks_pass_in_turns(capsys):
    api_test(search_v0.env(**SMALL), num_cycles=50)


def test_agents_that_do_what_the_protocol_does_take_as_long():
    problem = SearchProblem("square:80", robots=3)
    episode = shoal.run(problem, seed=2)
    env = search_v0.parallel_env(region="square:80", robots=3, action="cell")
    _, infos = env.reset(seed=2)
    visits = {
        f"robot_{number}": list(robot.cells)
        for number, robot in enumerate(episode.trace.robots, start=1)
    }
    while env.agents:
        actions = {}
        for agent in env.agents:
            free = infos[agent]["action_mask"][1:].any()
            actions[agent] = 1 + int(visits[agent].pop(0)) if free and visits[agent] else 0
        _, _, terminations, _, infos = env.step(actions)
    assert all(terminations.values())
    listening = 1
    assert abs(env.steps - (episode.trace.covered_at - listening)) <= 1


def walk(env, agent_actions):
    """Play actions; return what the last step told."""
    told = None
    for actions in agent_actions:
        told = env.step({agent: actions.get(agent, WAIT) for agent in env.agents})
    return told


def corridor(**options):
    """Return two robots in a row of six cells, at its ends."""
    starts = np.array([(5.0, 5.0), (55.0, 5.0)])
    return search_v0.parallel_env(region="rectangle:60x10", robots=2, starts=starts, **options)


def test_a_robot_searches_cell_by_cell_and_the_others_hear_of_it():
    env = corridor(reward="own", step_price=0.0)
    observations, infos = env.reset(seed=1)
    assert infos["robot_1"]["action_mask"].tolist() == [1, 1, 0, 0, 1, 0]
    _, rewards, *_ = walk(env, [{"robot_1": HERE, "robot_2": HERE}])
    assert rewards == {"robot_1": 1.0, "robot_2": 1.0}
    observations, rewards, *_ = walk(env, [{"robot_1": RIGHT}])
    assert rewards == {"robot_1": 1.0, "robot_2": 0.0}
    observations, *_ = walk(env, [{}, {}])
    assert observations["robot_1"]["position"].tolist() == [0, 1]
    assert observations["robot_2"]["planes"][search_v0.PLANES.index("searched")].tolist() == [
        [1, 1, 0, 0, 0, 1]
    ]
    assert observations["robot_2"]["told"].tolist() == [2, 1]
    _, rewards, terminations, _, infos = walk(
        env, [{"robot_1": RIGHT, "robot_2": LEFT}, {"robot_1": RIGHT, "robot_2": LEFT}]
    )
    assert terminations == {"robot_1": True, "robot_2": True}
    # who searched the last one
    assert rewards == {"robot_1": 11.0, "robot_2": 1.0 + 10.0} or sum(rewards.values()) == 21.0
    assert env.agents == []


def test_nothing_is_heard_when_all_messages_are_lost():
    env = corridor(loss=1.0)
    env.reset(seed=1)
    observations, *_ = walk(env, [{"robot_1": HERE, "robot_2": HERE}, {}, {}])
    assert observations["robot_2"]["heard"].tolist() == [-1.0, 0.0]
    assert observations["robot_2"]["told"].tolist() == [0, 1]


def test_how_long_ago_a_robot_was_heard():
    # from time 2 on nothing passes between robots 1 and 2
    env = corridor(network="partition:2:100")
    observations, _ = env.reset(seed=1)
    observations, *_ = walk(env, [{}, {}, {}, {}, {}])
    assert 3.0 <= observations["robot_1"]["heard"][1] <= 4.0


def test_a_robot_that_dies_leaves():
    env = corridor(faults=["crash:2@2.5"])
    env.reset(seed=1)
    _, _, terminations, *_ = walk(env, [{}, {}])
    assert terminations == {"robot_1": False, "robot_2": False}
    observations, rewards, terminations, _, _ = walk(env, [{}])
    assert terminations == {"robot_1": False, "robot_2": True}
    assert set(observations) == set(rewards) == {"robot_1", "robot_2"}
    assert env.agents == ["robot_1"]
    assert set(walk(env, [{}])[0]) == {"robot_1"}


def test_shared_rewards_are_the_mean():
    env = corridor(step_price=0.5)
    env.reset(seed=1)
    assert walk(env, [{"robot_1": HERE}])[1] == {"robot_1": 0.0, "robot_2": 0.0}


def test_robots_start_at_their_launch_points():
    env = search_v0.parallel_env(**SMALL | {"robots": 2, "launch": "5,5;-9,45"})
    observations, _ = env.reset(seed=1)
    assert [observations[agent]["position"].tolist() for agent in env.agents] == [[4, 0], [0, 0]]


def test_render_modes():
    env = corridor(render_mode="ansi", faults=["crash:2@0.5"])
    env.reset(seed=1)
    assert env.render() == "1????2"
    walk(env, [{"robot_1": HERE}, {"robot_1": RIGHT}])
    assert env.render() == ".1???x"
    env = corridor(render_mode="rgb_array")
    env.reset(seed=1)
    assert env.render().shape == (80, 480, 3)
    env = corridor(render_mode="human")
    env.reset(seed=1)
    assert env.render() is None
    env.close()
    env.close()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"robots": 0}, "robots: expected"),
        ({"loss": 2}, "loss: expected"),
        ({"action": "jump"}, "action: expected"),
        ({"allocation": "hop"}, "allocation: expected no such option"),
        ({"live": 3.0}, "live: expected no such option"),
        ({"region": "no/such.geojson"}, "no/such.geojson"),
        ({"obstacles": 30}, "obstacles: expected"),
    ],
)
def test_bad_options(options, words):
    with pytest.raises(shoal.envs.OptionError, match=words) as caught:
        search_v0.parallel_env(**(SMALL | options))
    assert "\n" not in str(caught.value)


def test_wrong_steps():
    env = search_v0.parallel_env(**(SMALL | {"max_cycles": 1}))
    for method in (lambda: env.step({}), env.render):
        with pytest.raises(gymnasium.error.ResetNeeded):
            method()
    env.reset(seed=1)
    everyone = dict.fromkeys(env.agents, 0)
    for actions in (
        None,
        {},
        everyone | {"robot_2": 6},
        everyone | {"robot_2": "up"},
        [0, 0, 0, 0],
    ):
        with pytest.raises(
            gymnasium.error.InvalidAction, match=r"robot_\d: expected an action from 0 to 5"
        ):
            env.step(actions)
    with pytest.raises(
        gymnasium.error.InvalidAction, match="names from robot_1 to robot_4, got 'robot_5'"
    ):
        env.step(everyone | {"robot_5": 0})
    assert all(env.step(everyone)[3].values()), "truncated by max_cycles"
    assert env.step({}) == ({}, {}, {}, {}, {})
    with pytest.raises(gymnasium.error.ResetNeeded, match="expected a reset first"):
        env.step(everyone)


def beliefs(env, observations):
    """Return what each agent believes, along the tour."""
    cells = tuple(env.unwrapped._tour.cells.T)
    return {agent: found["likely"][cells].astype(float) for agent, found in observations.items()}


def test_a_belief_is_the_prior_after_all_known_searches_by_bayes():
    """Out of range of each other, robots believe different things."""
    env = search_v0.parallel_env(
        region="square:50",
        robots=2,
        prior=["ring:20,30:0.5=15"],
        targets=1,
        detection=0.6,
        network="range:2",
        action="cell",
    )
    observations, infos = env.reset(seed=3)
    odds = env.unwrapped._plan.tour_cost.odds
    for own in beliefs(env, observations).values():
        np.testing.assert_allclose(own, odds, atol=1e-6)
    rng = np.random.default_rng(1)
    for _ in range(12):
        actions = {
            agent: int(rng.choice(np.flatnonzero(infos[agent]["action_mask"])))
            for agent in env.agents
        }
        observations, *_, infos = env.step(actions)
    different = []
    for number, own in enumerate(beliefs(env, observations).values(), start=1):
        robot = env.unwrapped._robot(number)
        looks = np.zeros(len(own))
        for _, cell in env.unwrapped._world.vehicles[number].visits:
            looks[cell] += 1
        known = [bits for other, bits in robot.searched.items() if other != number]
        for cell in range(len(own)):
            if looks[cell] == 0 and any(bits >> cell & 1 for bits in known):
                looks[cell] = 1
        expected = odds * 0.4**looks
        np.testing.assert_allclose(own, expected / expected.sum(), atol=1e-6)
        different.append(own)
    assert np.abs(different[0] - different[1]).max() > 0.01


def found_after(seed, **more):
    """Return the steps until two robots find a target at random, their rewards, and all actions."""
    env = search_v0.parallel_env(
        region="square:50",
        robots=2,
        targets=1,
        until="found",
        found_reward=7,
        reward="own",
        searched_reward=0,
        step_price=0,
        final_bonus=0,
        prior=["ring:20,30:0.5=15"],
        **more,
    )
    _, infos = env.reset(seed=seed)
    rng, total, steps = np.random.default_rng(seed), 0.0, 0
    while env.agents:
        actions = {
            agent: int(rng.choice(np.flatnonzero(infos[agent]["action_mask"])))
            for agent in env.agents
        }
        _, rewards, terminations, _, infos = env.step(actions)
        total += sum(rewards.values())
        steps += 1
    return steps, total, all(terminations.values())


@pytest.mark.parametrize("moves", [0.0, 0.5])
def test_who_finds_a_target_is_rewarded_once_and_seeds_repeat(moves):
    more = {"target_moves": moves} if moves else {}
    for seed in range(3):
        steps, total, found = found_after(seed, **more)
        assert found
        assert total == 7
        assert found_after(seed, **more) == (steps, total, found)
    assert len({found_after(seed, **more)[0] for seed in range(5)}) > 1


def test_a_moving_target_spreads_what_robots_believe():
    env = search_v0.parallel_env(
        region="square:50",
        robots=1,
        targets=1,
        prior=["ring:25,25:0.99=4"],
        target_moves=0.8,
        detection=0,
    )
    observations, _ = env.reset(seed=1)
    before = observations["robot_1"]["likely"]
    after = env.step({"robot_1": 0})[0]["robot_1"]["likely"]
    assert before.argmax() == 12
    assert after[2, 2] == pytest.approx(0.2 * before[2, 2] + 0.2 * 4 * before[1, 2], abs=0.01)
    assert after.sum() == pytest.approx(1, abs=1e-5)


@pytest.mark.parametrize(
    ("more", "match"),
    [
        ({"found_reward": 1}, "expected targets"),
        ({"until": "found"}, "expected targets"),
        ({"targets": 1, "obstacles": 1, "target_moves": 0.1}, "expected no obstacles"),
    ],
)
def test_options_of_targets_need_targets(more, match):
    with pytest.raises(shoal.envs.OptionError, match=match):
        search_v0.parallel_env(**SMALL, **more)
    with pytest.raises(shoal.envs.OptionError, match="only search_v0"):
        shoal.envs.SearchEnv(region="square:50", targets=1, until="found")


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"drift": (0.2, 0.0, 0.0)}, "prior: expected a target that stands still"),
        ({"passes": 2}, "prior: expected one pass at one altitude"),
        ({"at_most": 1.5}, "at_most: expected no such option"),
    ],
)
def test_priors_that_agents_cannot_observe_are_refused(more, words):
    for make in (search_v0.parallel_env, SearchEnv):
        with pytest.raises(OptionError, match=words):
            make(region="square:60", prior=["ring:20,30:0.5=15"], **more)


def test_agents_decide_themselves_where_they_look_again():
    env = search_v0.parallel_env(region="square:60", prior=["ring:20,30:0.5=15"], detection=0.7)
    assert env.reset(seed=1)[0]["robot_1"]["likely"].shape == (6, 6)
