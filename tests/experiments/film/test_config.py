"""A film's configuration is read whole, or refused with the path of what is wrong."""

import pytest

from experiments.config.requirements import requirements
from experiments.errors import ConfigError
from experiments.film.command import GifConfig, load_film
from experiments.running.versions import REPOSITORY
from tests.experiments.fakes import spoil


def test_what_is_written_is_what_is_read(film_data, write_config):
    config = load_film(write_config(film_data), ["trials=3", "agent=random"])
    assert (config.trials, config.agent.name, config.agent.label) == (3, "random", "random")
    assert config.perturbations[0]["do"]["degrees"] == 15
    assert config.env.observation == "points"
    assert config.gif == GifConfig(width=120, frames_per_second=4)
    short = {key: film_data[key] for key in ("agent", "env", "trials")}
    config = load_film(write_config(short))
    assert (config.width, config.height, config.gif.width, config.learn) == (1080, 780, 720, True)


def test_settings_and_models_are_found_beside_the_file(film_data, write_config, tmp_path):
    (tmp_path / "settings.yaml").write_text("probe_px: 12.0")
    (tmp_path / "arms").mkdir()
    hobby = (REPOSITORY / "tests/arms/models/hobby.xml").read_text()
    (tmp_path / "arms/mine.xml").write_text(hobby)
    film_data["agent"] = {"name": "unified_servo", "settings": "settings.yaml"}
    film_data["env"] |= {"arm": {"model": "arms/mine.xml", "gripper": "tip"}, "max_episode_steps": 4}
    config = load_film(write_config(film_data))
    assert config.agent.settings == {"probe_px": 12.0}
    assert f"{tmp_path}/arms" in config.env.arm["model"]


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        ("agent", "memori", "agent.name: found 'memori': unknown agent 'memori' (did you mean memory?)"),
        ("agent", {"name": "memory", "settings": {"lucks": 3}}, "agent 'memory' has no setting 'lucks'"),
        ("agend", "memory", "agend: unknown key (did you mean agent?)"),
        ("env.wold", "wild", "env.wold: unknown key (did you mean world?)"),
        ("env.world", "wilde", "env.world: found 'wilde': unknown (did you mean wilder or wild?)"),
        ("env.observation", "pixels", "env.observation: found 'pixels'"),
        ("gif.widht", 100, "gif.widht: unknown key (did you mean width?)"),
        ("gif.width", 300, "gif.width is 300: it must be at most the film's 216"),
        ("gif.frames_per_second", 9, "gif.frames_per_second is 9: it must be at most the film's 8"),
        ("height", 157, "height: found 157: it must be even"),
        ("height", 120, "height: found 120"),
        ("width", 150, "width: found 150: it must be at least the height, 156"),
        ("trials", 0, "trials: found 0"),
        ("first_trial", 3, "first_trial: found 3: there are 2 trials"),
        ("perturbations.0.at", {"trial": 2}, "perturbations.0.at.trial is 2: never, in 2 trials"),
        ("perturbations.0.do", {"type": "camera_rol"}, "did you mean camera_roll"),
        ("perturbations.0.do", {"type": "motor_sign", "motor": "J9"}, "motor_sign.motor is 'J9'"),
    ],
)
def test_what_is_wrong_is_named(film_data, refused, path, value, said):
    spoil(film_data, [int(key) if key.isdigit() else key for key in path.split(".")], value)
    found = refused(film_data, load=load_film)
    assert said in found
    assert "suite.yaml" in found.splitlines()[0]


def test_learners_of_many_arms_are_refused(film_data, write_config, monkeypatch):
    def of_four(agent, env):
        return requirements(agent, env)._replace(rows=4)

    monkeypatch.setattr("experiments.film.command.requirements", of_four)
    with pytest.raises(ConfigError, match=r"agent: 'unified_servo' learns from 4 arms at once; a film shows"):
        load_film(write_config(film_data))


@pytest.mark.parametrize(
    "path", sorted((REPOSITORY / "configs").glob("film*.yaml")), ids=lambda path: path.stem
)
def test_shipped_films_are_valid(path):
    config = load_film(path)
    assert config.words == (not path.stem.startswith("film-task-"))
    assert config.band == (120 if config.words else 0)
