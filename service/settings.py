"""Settings of the service: from the environment (`DOHYO_...`), a .env file, or the command line."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, SecretStr
from pydantic_settings import BaseSettings, SettingsConfigDict


class Settings(BaseSettings):
    """How one service runs.

    Attributes:
        data: Folder of records, policies, networks and the SQLite database.
        database: SQLAlchemy URL; None: SQLite in the data folder.
        host: Where to listen; other than loopback needs TLS or `insecure`.
        port: 0 chooses a free one.
        tls_certificate: PEM file.
        tls_key: PEM file.
        insecure: Listen beyond loopback without TLS, such as behind a proxy that ends it.
        executor: What drives built-in and ONNX agents: this machine's processes, or a Ray cluster.
        ray_address: Of that cluster; "auto": the one this machine belongs to, or what RAY_ADDRESS says.
        processes: Episodes driven at once by built-in and ONNX agents; each keeps a process on this machine, too, which
            on a cluster only waits.
        remote_episodes: Episodes of remote agents alive at once.
        queue_limit: Episodes waiting at once, over all submitters.
        evaluations_per_owner: Unfinished evaluations one owner may have.
        requests_per_minute: Per token, the wire of policy workers apart.
        body_limit_bytes: Of any request but an upload.
        upload_limit_bytes: Of an uploaded policy or network.
        public: Whether leaderboards, episodes and replays can be read without a token.
        cors_origins: Browsers' origins that may call the API.
        lease_ttl_s: A worker silent for longer loses its lease.
        act_deadline_s: Wall-clock time for one decision where the simulation waits.
        webhook_private_addresses: Let webhooks call this machine and its private network.
        webhook_authorities: PEM file of certificates, beyond those that everybody trusts, that webhooks may prove with.
        drain_s: After SIGTERM, time for running episodes to end.
    """

    model_config = SettingsConfigDict(env_prefix="DOHYO_", env_file=".env", extra="ignore", frozen=True)

    data: Path = Path("dohyo-data")
    database: SecretStr | None = None
    host: str = "127.0.0.1"
    port: Annotated[int, Field(ge=0, le=65535)] = 8000
    tls_certificate: Path | None = None
    tls_key: Path | None = None
    insecure: bool = False
    executor: Literal["processes", "ray"] = "processes"
    ray_address: Annotated[str, Field(min_length=1)] = "auto"
    processes: Annotated[int, Field(ge=1, le=1024)] = Field(default_factory=lambda: os.cpu_count() or 1)
    remote_episodes: Annotated[int, Field(ge=1, le=1024)] = 8
    queue_limit: Annotated[int, Field(ge=1)] = 100_000
    evaluations_per_owner: Annotated[int, Field(ge=1)] = 20
    requests_per_minute: Annotated[int, Field(ge=1)] = 600
    body_limit_bytes: Annotated[int, Field(ge=1024)] = 4_000_000
    upload_limit_bytes: Annotated[int, Field(ge=1024)] = 50_000_000
    public: bool = True
    cors_origins: tuple[str, ...] = ()
    lease_ttl_s: Annotated[float, Field(gt=0)] = 30.0
    act_deadline_s: Annotated[float, Field(gt=0)] = 10.0
    webhook_private_addresses: bool = False
    webhook_authorities: Path | None = None
    drain_s: Annotated[float, Field(ge=0)] = 30.0

    @property
    def database_url(self) -> str:
        """The URL to connect to."""
        if self.database is not None:
            return self.database.get_secret_value()
        return f"sqlite:///{(self.data / 'dohyo.db').resolve()}"

    @property
    def records(self) -> Path:
        """Finished records by content hash: `ab/abcd....json` beside its Parquet."""
        return self.data / "records"

    @property
    def staging(self) -> Path:
        """Records of episodes being driven, a folder per evaluation."""
        return self.data / "staging"

    @property
    def policies(self) -> Path:
        """Uploaded policies by content hash."""
        return self.data / "policies"
