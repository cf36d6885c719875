import subprocess
import sys
from pathlib import Path

import pytest

from stereomend.errors import ConfigurationError
from stereomend.settings import Settings, load_settings


@pytest.fixture(autouse=True)
def empty_environment(monkeypatch):
    for name in Settings.model_fields:
        monkeypatch.delenv(f"STEREOMEND_{name.upper()}", raising=False)
    monkeypatch.delenv("STEREOMEND_CONFIG", raising=False)


def test_a_flag_beats_the_environment_beats_the_file_beats_the_default(tmp_path, monkeypatch):
    assert load_settings().port == 8000
    config = tmp_path / "stereomend.toml"
    config.write_text("port = 8001\nworkers = 3\n")
    monkeypatch.setenv("STEREOMEND_CONFIG", str(config))
    assert (load_settings().port, load_settings().workers) == (8001, 3)
    monkeypatch.setenv("STEREOMEND_PORT", "8002")
    assert (load_settings().port, load_settings().workers) == (8002, 3)
    assert load_settings(port="8003").port == 8003


def test_keys_come_separated_by_commas_and_are_not_printed(monkeypatch):
    monkeypatch.setenv("STEREOMEND_API_KEYS", "first-key, second-key,")
    settings = load_settings()
    assert [key.get_secret_value() for key in settings.api_keys] == ["first-key", "second-key"]
    assert "first-key" not in repr(settings)


def test_other_addresses_than_loopback_are_reachable():
    assert load_settings(host="0.0.0.0").reachable
    assert not any(load_settings(host=host).reachable for host in ("127.0.0.1", "::1", "localhost"))


@pytest.mark.parametrize("given", ["tls_certfile", "tls_keyfile"])
def test_a_certificate_and_its_key_come_together(given):
    with pytest.raises(ConfigurationError, match="expected both or none"):
        load_settings(**{given: "server.pem"})


@pytest.mark.parametrize(
    ("flags", "named"),
    [({"port": 70000}, "port"), ({"workers": "many"}, "workers"), ({"colour": 1}, "colour")],
)
def test_wrong_settings_are_named(flags, named):
    with pytest.raises(ConfigurationError, match=named):
        load_settings(**flags)


def test_a_missing_or_misspelt_file_is_named(tmp_path, monkeypatch):
    monkeypatch.setenv("STEREOMEND_CONFIG", str(tmp_path / "none.toml"))
    with pytest.raises(ConfigurationError, match=r"none\.toml"):
        load_settings()
    (tmp_path / "none.toml").write_text("prot = 1\n")
    with pytest.raises(ConfigurationError, match="prot"):
        load_settings()
    (tmp_path / "none.toml").write_text("port = = 1\n")
    with pytest.raises(ConfigurationError, match=r"none\.toml"):
        load_settings()


def test_the_readme_and_the_help_know_every_setting():
    readme = (Path(__file__).parents[1] / "README.md").read_text()
    shown = subprocess.run(
        [sys.executable, "-m", "stereomend", "serve", "--help"], capture_output=True, text=True, check=True
    ).stdout
    for name, field in Settings.model_fields.items():
        default = "" if field.default in ((), None) else f"`{field.default}`"
        assert f"| `{name}` | {default} | {field.description} |" in readme
        assert f"--{name.replace('_', '-')} " in shown
