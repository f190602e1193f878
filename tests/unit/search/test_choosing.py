"""Comparisons of plans that a user ends early."""

import signal

import pytest

from shoal.core.notices import listeners
from shoal.search import SearchProblem, plan_search
from shoal.search.planning import choosing, orientation
from shoal.search.planning.choosing import one_by_one, stoppable_comparisons


def compared(interrupted_at):
    seen = []
    with one_by_one("abcd", "letters") as each:
        for letter in each:
            seen.append(letter)
            if letter in interrupted_at:
                signal.raise_signal(signal.SIGINT)
    return seen


def test_the_best_so_far_after_an_interruption(monkeypatch):
    notices = []
    monkeypatch.setattr("shoal.core.notices.listeners", [*listeners, notices.append])
    with stoppable_comparisons(notices.append):
        assert compared("b") == ["a", "b"]
        assert compared("") == ["a"]  # what follows takes its first choice
    assert compared("") == list("abcd")
    assert notices[0] == "plan: interrupted: the best of 2 letters, of 4 to compare"


def test_an_interruption_with_nothing_to_take():
    with pytest.raises(KeyboardInterrupt), stoppable_comparisons(print):
        compared("a")
    with pytest.raises(KeyboardInterrupt):  # in Python, Ctrl-C is what it always is
        compared("b")


def test_a_second_interruption():
    with stoppable_comparisons(print), one_by_one("abcd", "letters") as each:
        for _ in each:
            pass
        signal.raise_signal(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)


def test_how_far_a_comparison_is(monkeypatch):
    monkeypatch.setattr(choosing, "_EVERY", -1.0)
    said = []
    with stoppable_comparisons(said.append):
        compared("")
    assert said[0] == "1 of 4 letters are compared; Ctrl-C takes the best so far"


def test_an_interrupted_plan_is_complete(monkeypatch):
    problem = SearchProblem("rectangle:130x70", robots=2, footprint=10, angle="auto")
    made, through = [], orientation._through

    def interrupted(*given, **options):
        made.append(through(*given, **options))
        if len(made) == 2:
            signal.raise_signal(signal.SIGINT)
        return made[-1]

    monkeypatch.setattr(orientation, "_through", interrupted)
    with stoppable_comparisons(print):
        plan = plan_search(problem, seed=1)
    assert len(made) == 3  # one more at the other price
    assert len(plan.tour_cost) == plan.grid.n_cells
