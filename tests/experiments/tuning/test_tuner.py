"""Tries, budgets and the choice, with objectives that are known beforehand."""

import json

import pytest

from experiments.errors import ConfigError
from experiments.tuning.tuner import DefaultsFailError
from tests.experiments.tuning.conftest import KnownLifetimes, counted, quadratic


def settings_of(found):
    return [each["settings"] for each in found["tries"]]


def test_a_minimum_that_is_known_is_found_and_chosen(tune):
    lifetimes = KnownLifetimes(quadratic)
    found = tune(lifetimes)
    assert settings_of(found)[0] == {"damping": 0.05}  # as by default
    assert len(found["tries"]) == 20
    assert found["stopped_by"] == "20 tries"
    assert 0.15 < found["best"]["damping"] < 0.27
    assert found["choice"] == "tuned"
    assert found["settings"] == found["best"]
    assert len(lifetimes.made) <= 2 * 20 + 2 * 4
    check = found["check"]
    assert check["default"] == [quadratic(found["default"], world) for world in (2, 3, 4, 5)]
    assert check["difference"]["high"] < 0
    assert json.loads(json.dumps(found))["tries"][1]["state"] == "complete"


@pytest.mark.parametrize("share", [0.0, 0.05, 0.3, 0.7, 0.9])  # the last one: within the check
def test_killed_and_started_again_it_makes_the_same_tries(tune, share):
    whole = KnownLifetimes(quadratic)
    undisturbed = tune(whole, journal="undisturbed", tries=12)
    most = int(share * len(whole.made))
    with pytest.raises(KeyboardInterrupt):
        tune(KnownLifetimes(counted(quadratic, most)), tries=12)
    again = KnownLifetimes(quadratic)
    assert tune(again, tries=12) == undisturbed
    assert len(again.made) <= len(whole.made) - most + 4  # what one process makes at most
    left = len(again.made)
    assert tune(again, tries=12) == undisturbed
    assert len(again.made) == left  # nothing is left to do


def test_a_line_that_a_kill_has_torn_is_made_again(tune, tmp_path):
    undisturbed = tune(KnownLifetimes(quadratic), tries=4)
    journal = tmp_path / "studies" / "jacobian_servo.journal"
    whole = journal.read_bytes()
    for end in range(len(whole) - 1, len(whole) // 3, -len(whole) // 8):
        journal.write_bytes(whole[:end])
        assert tune(KnownLifetimes(quadratic), tries=4) == undisturbed


def test_the_budget_of_cpu_time_is_kept(tune):
    found = tune(KnownLifetimes(quadratic, cpu_seconds=10.0), cpu_minutes=1.2)
    assert [each["state"] for each in found["tries"]] == ["complete"] * 3
    assert found["cpu_minutes"] == 1.0
    assert found["stopped_by"] == "1.2 CPU minutes: another try would exceed them"


def test_what_takes_longer_than_it_was_expected_to_is_stopped_within(tune):
    lifetimes = KnownLifetimes(quadratic, cpu_seconds=10.0)

    def dearer_later(settings, world):
        lifetimes.cpu_seconds = 10.0 if len(lifetimes.made) < 4 else 60.0
        return quadratic(settings, world)

    lifetimes.objective = dearer_later
    found = tune(lifetimes, cpu_minutes=1.5)
    assert found["tries"][-1]["state"] == "out of time"
    assert found["tries"][-1]["objective"] is None
    assert found["cpu_minutes"] == 1.5
    assert "ran out within try" in found["stopped_by"]
    assert tune(lifetimes, cpu_minutes=1.5) == found
    assert len(tune(lifetimes, cpu_minutes=10)["tries"]) > len(found["tries"])


def test_the_first_try_alone_is_too_dear(tune):
    found = tune(KnownLifetimes(quadratic, cpu_seconds=100.0), cpu_minutes=1.0)
    assert found["choice"] == "default"
    assert found["best"] is None
    assert found["check"] is None


def test_a_try_that_ran_out_of_time_is_made_again_where_more_is_left(tune):
    lifetimes = KnownLifetimes(quadratic, cpu_seconds=40.0)
    assert tune(lifetimes, cpu_minutes=1.0)["tries"][0]["state"] == "out of time"
    undisturbed = tune(lifetimes, cpu_minutes=10, journal="undisturbed")
    for _ in range(2):
        assert tune(lifetimes, cpu_minutes=10) == undisturbed


def test_the_default_settings_stay_unless_the_whole_interval_favours_others(tune):
    def better_in_the_worlds_of_tries_alone(settings, world):
        gain = 1.0 if world < 2 else (-1.0) ** world
        return 10.0 - gain * (settings["damping"] > 0.1)

    found = tune(KnownLifetimes(better_in_the_worlds_of_tries_alone))
    assert found["best"]["damping"] > 0.1
    assert found["check"]["difference"]["low"] < 0 < found["check"]["difference"]["high"]
    assert found["choice"] == "default"
    assert found["settings"] == {"damping": 0.05}


def test_where_no_try_is_better_nothing_is_compared(tune):
    found = tune(KnownLifetimes(lambda settings, world: 10.0 + (settings["damping"] != 0.05)))
    assert found["choice"] == "default"
    assert found["best"] == {"damping": 0.05}
    assert found["check"] is None


def test_what_is_worse_than_the_median_of_earlier_tries_is_given_up_after_a_world(tune):
    found = tune(KnownLifetimes(quadratic))
    pruned = [each for each in found["tries"] if each["state"] == "pruned"]
    assert pruned
    for each in pruned:
        assert len(each["worlds"]) == 1
        assert each["objective"] is None
        earlier = found["tries"][: found["tries"].index(each)]
        first = sorted(one["worlds"][0] for one in earlier if one["state"] == "complete")
        assert len(first) >= 5
        assert each["worlds"][0] > first[(len(first) - 1) // 2]


def test_settings_with_which_an_agent_fails_count_as_worst(tune):
    def fails(settings, world):
        return "ValueError: no" if settings["damping"] > 0.1 else quadratic(settings, world)

    found = tune(KnownLifetimes(fails))
    failed = [each for each in found["tries"] if each["state"] == "failed"]
    assert failed
    assert all((each["objective"], each["error"]) == (20.0, "ValueError: no") for each in failed)
    assert found["best"]["damping"] <= 0.1


def test_an_agent_that_fails_with_its_default_settings_is_not_tuned(tune):
    with pytest.raises(DefaultsFailError, match="ValueError: no"):
        tune(KnownLifetimes(lambda settings, world: "ValueError: no"))


def test_settings_that_come_again_cost_nothing(tune):
    choices = {"estimator": ["kalman", "rls"], "redundancy": ["weighted", "omit"]}
    agent = {"name": "jacobian_servo", "scenario": "aimed", "choices": choices}
    lifetimes = KnownLifetimes(lambda settings, world: 10.0 + (settings["estimator"] == "rls"))
    found = tune(lifetimes, agents=[agent])
    assert len(found["tries"]) == 20
    distinct = {json.dumps(settings) for settings in settings_of(found)}
    assert len(distinct) <= 4
    made = [json.dumps(each) for each in lifetimes.made]
    assert len(made) == len(set(made))
    assert found["choice"] == "default"
    again = [each for each in found["tries"] if each["state"] == "repeated"]
    assert len(again) == 20 - len(distinct)
    assert all(each["objective"] in (10.0, 11.0, None) for each in again)


def test_rounded_settings_stay_within_their_range(tune):
    damping = {"low": 0.05, "high": 0.05009}
    agent = {"name": "jacobian_servo", "scenario": "aimed", "ranges": {"damping": damping}}
    found = [each["damping"] for each in settings_of(tune(KnownLifetimes(quadratic), agents=[agent]))]
    assert max(found) == 0.05009


def test_tries_of_other_code_or_of_another_configuration_are_refused(tune):
    tune(KnownLifetimes(quadratic), tries=2)
    with pytest.raises(
        ConfigError, match=r"versions\.code 'this', not 'other': its tries are not comparable"
    ):
        tune(KnownLifetimes(quadratic), code="other")
    with pytest.raises(ConfigError, match="seed 7, not 8"):
        tune(KnownLifetimes(quadratic), seed=8)
    assert len(tune(KnownLifetimes(quadratic), tries=3)["tries"]) == 3


def test_a_damaged_journal_is_named(tune, tmp_path):
    tune(KnownLifetimes(quadratic), tries=2)
    journal = tmp_path / "studies" / "jacobian_servo.journal"
    lines = journal.read_text().splitlines(keepends=True)
    journal.write_text("".join([*lines[:2], "nonsense\n", *lines[2:]]))
    with pytest.raises(ConfigError, match=r"jacobian_servo\.journal is damaged"):
        tune(KnownLifetimes(quadratic))
