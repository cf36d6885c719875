"""The command `stereomend keys`: makes, lists and revokes API keys of the data folder."""

from __future__ import annotations

import argparse
import sys
from contextlib import closing
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from stereomend.jobs.keys import Key, KeyStore

# Loaded with every command: what it needs is imported when it runs.


def add_to(parser: argparse.ArgumentParser) -> None:
    """Describe the command's own commands, and set what runs them."""
    commands = parser.add_subparsers(required=True, metavar="add|list|revoke")
    add = commands.add_parser("add", help="make a key and print it, this once")
    add.add_argument("name", metavar="NAME", help="whose key it is, for `list`")
    add.add_argument(
        "--scopes",
        default="submit,read",
        help="of submit, read and admin, which is both for everybody's jobs (default submit,read)",
    )
    add.set_defaults(run=_add)
    commands.add_parser("list", help="show ids, names and scopes").set_defaults(run=_list)
    revoke = commands.add_parser("revoke", help="make a key worthless, within a second")
    revoke.add_argument("id", metavar="ID", help="as `list` shows it")
    revoke.set_defaults(run=_revoke)
    for command in commands.choices.values():
        command.add_argument("--data-dir", type=Path, metavar="DIR", help="that of the server")
    parser.set_defaults(command=_keys)


def _keys(options: argparse.Namespace) -> int:
    from stereomend.jobs.folder import open_ledger
    from stereomend.jobs.keys import KeyStore
    from stereomend.settings import load_settings

    with closing(open_ledger(load_settings(data_dir=options.data_dir).data_dir)) as ledger:
        options.run(KeyStore(ledger.engine), options)
    return 0


def _add(store: KeyStore, options: argparse.Namespace) -> None:
    scopes = [scope.strip() for scope in options.scopes.split(",") if scope.strip()]
    key, secret = store.add(options.name, scopes)
    # The key alone on standard output, for `KEY=$(stereomend keys add NAME)`.
    print(f"id {key.id}, {_scopes(key)}; the key is not shown again:", file=sys.stderr)
    print(secret)


def _list(store: KeyStore, _: argparse.Namespace) -> None:
    rows = [("ID", "NAME", "SCOPES", "MADE", "REVOKED"), *map(_row, store.all())]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        print("  ".join(f"{cell:{width}s}" for cell, width in zip(row, widths, strict=True)).rstrip())


def _revoke(store: KeyStore, options: argparse.Namespace) -> None:
    key = store.revoke(options.id)
    print(f"{key.id} ({key.name}) is revoked")


def _row(key: Key) -> tuple[str, ...]:
    return key.id, key.name, _scopes(key), _day(key.created_at), _day(key.revoked_at)


def _scopes(key: Key) -> str:
    return ",".join(sorted(key.scopes))


def _day(when: datetime | None) -> str:
    return f"{when:%Y-%m-%d %H:%M}" if when else "-"
