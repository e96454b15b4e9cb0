"""Settings of the service: from the environment (`DOHYO_...`), a .env file, or the command line."""

from __future__ import annotations

import difflib
import ipaddress
import json
import re
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, SecretStr
from pydantic_settings import BaseSettings, DotEnvSettingsSource, EnvSettingsSource, NoDecode, SettingsConfigDict

from dohyo.sumo_networks.processes import usable_processors

DAYS = 36_500
"""Most days that a setting may have: a century."""

PREFIX = "DOHYO_"
OTHER_VARIABLES = frozenset({"home", "cache", "policies", "server", "token", "site", "worker_tally"})
"""Variables of dohyo that are no settings of the service, without the prefix."""


def _words(value: Any) -> Any:
    """A list from text: by commas, or in JSON."""
    if not isinstance(value, str):
        return value
    return json.loads(value) if value.lstrip().startswith("[") else [one for one in re.split(r"[,\s]+", value) if one]


def _networks(value: tuple[str, ...]) -> tuple[str, ...]:
    for one in value:
        try:
            ipaddress.ip_network(one, strict=False)
        except ValueError as error:
            raise ValueError(f"expected addresses or networks such as 172.16.0.0/12, got '{one}'") from error
    return value


def _token(value: SecretStr | None) -> SecretStr | None:
    return value if value is not None and value.get_secret_value().strip() else None


Words = Annotated[tuple[str, ...], NoDecode, BeforeValidator(_words)]
Networks = Annotated[Words, AfterValidator(_networks)]
Secret = Annotated[SecretStr | None, AfterValidator(_token)]
"""A token; an empty one is none."""


class Settings(BaseSettings):
    """Settings of one service.

    Attributes:
        data: Folder of records, policies, networks and the SQLite database.
        database: SQLAlchemy URL; None: SQLite in the data folder.
        host: Address to listen on; any other than loopback needs TLS or `insecure`.
        port: Port to listen on; 0 chooses a free one.
        tls_certificate: PEM file.
        tls_key: PEM file.
        insecure: Listen beyond loopback without TLS, such as behind a proxy that ends it.
        executor: Executor of built-in and ONNX agents: processes on this machine, or a Ray cluster.
        ray_address: Address of the cluster; "auto": this machine's cluster or the value of RAY_ADDRESS.
        processes: Episodes driven at once by built-in and ONNX agents; each has a process on this machine, even if a
            cluster drives.
        remote_episodes: Most live episodes of remote agents. Of each kind one more is driven for an owner of whom none
            is, so that nobody waits for the end of another owner's long episode.
        episode_limit_s: Wall-clock limit of the simulation of one drive, s. Beyond it the machine has failed, and the
            episode is driven again. The agent's decisions may take half as much beside it; beyond that it has failed.
        queue_limit: Most waiting episodes over all submitters.
        queued_per_owner: Most waiting episodes of one owner.
        evaluations_per_owner: Most unfinished evaluations of one owner.
        read_seconds_per_minute: Processor seconds a minute that one owner, or one address without a token, may use for
            maps, replays, boards, tables, records, explanations, comparisons and rescoring; and as many again for
            orders of evaluations, and for parsing long bodies.
        bytes_per_owner: Most bytes that one owner keeps: records, policies, networks, uploads that wait.
        networks_per_owner: Most uploaded networks of one owner; the service holds 100.
        records_kept_days: Days after the end of an evaluation or world after which its records' files go, of ranked
            runs too; rows and scores stay. None: never.
        jobs: Jobs done at once, such as checks of uploads; each has about one process.
        jobs_per_owner: Most unfinished jobs of one owner.
        jobs_limit: Most unfinished jobs of all owners.
        jobs_kept_days: Days after which finished jobs are deleted; what they made stays.
        connections: Most open connections.
        connections_per_address: Most open connections of one address, a network of 64 bits of IPv6 counting as one.
        trusted_proxies: Addresses and networks of proxies, whose X-Forwarded-For says who the client is.
        runs_per_day: Most ranked runs of one agent on one benchmark version in 24 hours, outside of challenges.
        metrics_token: Bearer token for `GET /metrics`, and for nothing else; administrators' tokens may always read it.
            Empty: none.
        requests_per_minute: Limit per token, without the wire of policy workers.
        body_limit_bytes: Largest body of a request that is not an upload.
        upload_limit_bytes: Largest uploaded policy or network.
        league: Whether the dashboard leads to the league of dohyo's own systems.
        public: Whether leaderboards, episodes and replays are readable without a token.
        cors_origins: Origins of browsers that may call the API.
        process_deaths: Deaths of an episode's process after which the episode is lost. Its evaluation fails with the
            reason after its other episodes, and `resume` drives the lost ones once more.
        worlds: Most live worlds; each has a process on this machine.
        worlds_per_owner: Most live worlds of one owner.
        world_idle_s: Time without any request after which a world ends, s.
        lease_ttl_s: Silence after which a worker loses its lease, s.
        act_deadline_s: Wall-clock limit of one decision while the simulation waits, at least 0.1 s.
        webhook_private_addresses: Whether webhooks may call this machine and its private network.
        webhook_authorities: PEM file of certificate authorities for webhooks, besides the usual ones.
        drain_s: Time for running episodes to end after SIGTERM, s.
    """

    model_config = SettingsConfigDict(env_prefix=PREFIX, env_file=".env", extra="ignore", frozen=True)

    data: Annotated[Path, AfterValidator(Path.absolute)] = Path("dohyo-data")  # confined processes work elsewhere
    database: SecretStr | None = None
    host: str = "127.0.0.1"
    port: Annotated[int, Field(ge=0, le=65535)] = 8000
    tls_certificate: Path | None = None
    tls_key: Path | None = None
    insecure: bool = False
    executor: Literal["processes", "ray"] = "processes"
    ray_address: Annotated[str, Field(min_length=1)] = "auto"
    processes: Annotated[int, Field(ge=1, le=1024)] = Field(default_factory=usable_processors)
    remote_episodes: Annotated[int, Field(ge=1, le=1024)] = 8
    episode_limit_s: Annotated[float, Field(gt=0)] = 3600.0
    queue_limit: Annotated[int, Field(ge=1)] = 100_000
    queued_per_owner: Annotated[int, Field(ge=1)] = 20_000
    evaluations_per_owner: Annotated[int, Field(ge=1)] = 20
    read_seconds_per_minute: Annotated[float, Field(gt=0)] = 30.0
    bytes_per_owner: Annotated[int, Field(ge=1)] = 50_000_000_000
    networks_per_owner: Annotated[int, Field(ge=1)] = 20
    records_kept_days: Annotated[float | None, Field(gt=0, le=DAYS)] = None
    jobs: Annotated[int, Field(ge=1, le=64)] = 2
    jobs_per_owner: Annotated[int, Field(ge=1)] = 20
    jobs_limit: Annotated[int, Field(ge=1)] = 1000
    jobs_kept_days: Annotated[float, Field(gt=0, le=DAYS)] = 14.0
    connections: Annotated[int, Field(ge=8)] = 2000
    connections_per_address: Annotated[int, Field(ge=4)] = 256
    trusted_proxies: Networks = ("127.0.0.1", "::1")
    runs_per_day: Annotated[int, Field(ge=1)] = 10
    metrics_token: Secret = None
    requests_per_minute: Annotated[int, Field(ge=1)] = 600
    body_limit_bytes: Annotated[int, Field(ge=1024)] = 1_250_000
    upload_limit_bytes: Annotated[int, Field(ge=1024)] = 50_000_000
    league: bool = False
    public: bool = True
    process_deaths: Annotated[int, Field(ge=1)] = 10
    cors_origins: Words = ()
    worlds: Annotated[int, Field(ge=0, le=1024)] = 8
    worlds_per_owner: Annotated[int, Field(ge=1)] = 2
    world_idle_s: Annotated[float, Field(gt=0)] = 600.0
    lease_ttl_s: Annotated[float, Field(gt=0)] = 30.0
    act_deadline_s: Annotated[float, Field(ge=0.1)] = 10.0
    webhook_private_addresses: bool = False
    webhook_authorities: Path | None = None
    drain_s: Annotated[float, Field(ge=0)] = 30.0

    @property
    def database_url(self) -> str:
        """URL of the database."""
        if self.database is not None:
            return self.database.get_secret_value()
        return f"sqlite:///{(self.data / 'dohyo.db').resolve()}"

    @property
    def records(self) -> Path:
        """Folder of finished records by content hash: `ab/abcd....json` beside its Parquet file."""
        return self.data / "records"

    @property
    def staging(self) -> Path:
        """Folder of running episodes' records, with a folder per evaluation."""
        return self.data / "staging"

    @property
    def signing_key(self) -> Path:
        """File of the private key that signs records."""
        return self.data / "signing-key.pem"

    @property
    def retired_signing_keys(self) -> Path:
        """Folder of earlier signing keys, whose signatures still count."""
        return self.data / "retired-signing-keys"

    @property
    def policies(self) -> Path:
        """Folder of uploaded policies by content hash."""
        return self.data / "policies"

    @property
    def uploads(self) -> Path:
        """Folder of files that jobs will check, with a folder per job."""
        return self.data / "uploads"


def unknown_variables() -> list[str]:
    """A sentence on each variable of the environment or of `.env` that is named as a setting and is none."""
    given = {**DotEnvSettingsSource(Settings).env_vars, **EnvSettingsSource(Settings).env_vars}
    names = sorted(one.lower().removeprefix(PREFIX.lower()) for one in given if one.upper().startswith(PREFIX))
    told = []
    for name in names:
        if name in Settings.model_fields or name in OTHER_VARIABLES:
            continue
        near = difflib.get_close_matches(name, Settings.model_fields, 1)
        meant = f"; did you mean {PREFIX}{near[0].upper()}?" if near else ""
        told.append(f"{PREFIX}{name.upper()} is no setting and does nothing{meant}")
    return told
