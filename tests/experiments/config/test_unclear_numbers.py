"""Wherever a comparison is read from."""

import pytest

from experiments.config.loading import load
from experiments.errors import ConfigError


def test_unclear_numbers_are_named_by_the_file_that_holds_them(suite_data, write_config, tmp_path):
    config = write_config(suite_data)
    (tmp_path / "words.yaml").write_text("limit: 5e-1")
    (tmp_path / "claims.yaml").write_text("- {name: a, criteria: [{above: 0x1F}]}")
    for override, said in {
        "worlds=010": "--set worlds=010: found 010, which YAML takes for 8; allowed: decimal",
        "scenarios.0={motions: 1:30}": "motions: found 1:30, which YAML takes for 90",
        "agents.0.settings=words.yaml": "words.yaml:\n  limit: found '5e-1', which YAML takes for text",
        "claims=claims.yaml": "claims.yaml:\n  0.criteria.0.above: found 0x1F",
    }.items():
        with pytest.raises(ConfigError) as error:
            load(config, [override])
        assert said in str(error.value)
    text = config.read_text()
    for key in ("worlds: 2", "seed: 1", "tolerance_px: 4.0"):
        assert key in text
        config.write_text(text.replace(key, key.split()[0] + " 010"))
        with pytest.raises(ConfigError, match=rf"suite\.yaml:\n  \S*{key.split()[0]} found 010"):
            load(config)
