"""The settings of a server: a flag beats the environment beats the TOML file beats the default."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, SecretStr, ValidationError, field_validator, model_validator
from pydantic_settings import (
    BaseSettings,
    NoDecode,
    PydanticBaseSettingsSource,
    SettingsConfigDict,
    TomlConfigSettingsSource,
)

from stereomend.errors import ConfigurationError

LOOPBACK = ("127.0.0.1", "::1", "localhost")


class Settings(BaseSettings):
    """All settings, each also `STEREOMEND_<NAME>` in the environment. Build them with `load_settings`."""

    model_config = SettingsConfigDict(env_prefix="STEREOMEND_", frozen=True, extra="forbid")

    host: str = Field("127.0.0.1", description="address to listen on; other than loopback needs API keys")
    port: int = Field(8000, ge=0, le=65535, description="port to listen on; 0 takes a free one")
    backend: Literal["auto", "cuda", "native", "reference"] = Field("auto", description="what computes")
    workers: int = Field(1, ge=1, le=64, description="worker processes")
    threads: int = Field(
        0, ge=0, le=256, description="threads per worker; 0: the cores shared among the workers"
    )
    max_upload_mb: int = Field(256, ge=1, description="largest request body [MiB]")
    max_pixels: int = Field(16_000_000, ge=1, description="most pixels of one image")
    max_queued_jobs: int = Field(256, ge=1, description="most requests that wait or run")
    max_queued_mb: int = Field(4096, ge=1, description="most bytes of bodies that wait or run [MiB]")
    max_jobs_per_key: int = Field(64, ge=1, description="most durable jobs of one key that wait or run")
    data_dir: Annotated[Path, AfterValidator(Path.expanduser)] = Field(
        Path("~/.local/state/stereomend"),
        description="folder of the ledger, the blobs and the keys",
        validate_default=True,
    )
    result_ttl_s: float = Field(3600.0, gt=0, description="how long results are kept [s]")
    record_ttl_s: float = Field(86400.0, gt=0, description="how long records of ended jobs are kept [s]")
    lease_s: float = Field(30.0, ge=1, description="a worker silent for so long has lost its job [s]")
    min_free_disk_mb: int = Field(1024, ge=0, description="disk space that jobs leave free [MiB]")
    work_limit_s: float = Field(300.0, gt=0, description="longest time one refinement may take [s]")
    work_limit_mb: int = Field(8192, ge=256, description="most memory one refinement may take [MiB]")
    api_keys: Annotated[tuple[SecretStr, ...], NoDecode] = Field(
        (), description="accepted keys, comma-separated"
    )
    tls_certfile: Annotated[Path, AfterValidator(Path.expanduser)] | None = Field(
        None, description="PEM file of the certificate and those above it; serves https"
    )
    tls_keyfile: Annotated[Path, AfterValidator(Path.expanduser)] | None = Field(
        None, description="PEM file of the certificate's private key, not encrypted"
    )
    log_format: Literal["text", "json"] = Field("text", description="form of the log lines")

    @field_validator("api_keys", mode="before")
    @classmethod
    def _split(cls, keys: object) -> object:
        return tuple(key.strip() for key in keys.split(",") if key.strip()) if isinstance(keys, str) else keys

    @field_validator("tls_certfile", "tls_keyfile", mode="before")
    @classmethod
    def _none_if_empty(cls, path: object) -> object:
        return None if path == "" else path

    @model_validator(mode="after")
    def _whole(self) -> Settings:
        if (self.tls_certfile is None) != (self.tls_keyfile is None):
            raise ValueError("tls_certfile and tls_keyfile: one is set; expected both or none")
        return self

    @property
    def reachable(self) -> bool:
        """Whether other machines may reach the address."""
        return self.host not in LOOPBACK

    @property
    def threads_per_worker(self) -> int:
        """The threads one worker computes with."""
        return self.threads or max(1, len(os.sched_getaffinity(0)) // self.workers)

    @classmethod
    def settings_customise_sources(
        cls,
        settings_cls: type[BaseSettings],
        init_settings: PydanticBaseSettingsSource,
        env_settings: PydanticBaseSettingsSource,
        dotenv_settings: PydanticBaseSettingsSource,
        file_secret_settings: PydanticBaseSettingsSource,
    ) -> tuple[PydanticBaseSettingsSource, ...]:
        """Order the sources; the file is named by `STEREOMEND_CONFIG`."""
        config = os.environ.get("STEREOMEND_CONFIG")
        toml = TomlConfigSettingsSource(settings_cls, Path(config) if config else None)
        return init_settings, env_settings, toml


def load_settings(**flags: Any) -> Settings:
    """Read the settings; flags that are None count as not given.

    Raises:
        ConfigurationError: a value is out of range, a key of the file unknown, or the file not there.
    """
    config = os.environ.get("STEREOMEND_CONFIG")
    if config and not Path(config).is_file():
        raise ConfigurationError(f"STEREOMEND_CONFIG names {config}, which is not a file")
    try:
        return Settings(**{name: value for name, value in flags.items() if value is not None})
    except tomllib.TOMLDecodeError as error:
        raise ConfigurationError(f"{config} is not TOML: {error}") from error
    except ValidationError as error:
        raise ConfigurationError("; ".join(map(_sentence, error.errors()))) from error


def _sentence(error: Mapping[str, Any]) -> str:
    if error["type"] == "value_error":
        return str(error["ctx"]["error"])
    return f"{'.'.join(map(str, error['loc']))}: {error['msg']}"
