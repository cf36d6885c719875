"""The other end of `runner.run`: has PyCUDA loaded, and forks for each call that comes on standard input."""

import importlib.util
import os
import pickle
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any


def main() -> None:
    """Answers one call after the other, each with a line on standard output: the exit status."""
    import pycuda.driver  # noqa: F401  # its import is what takes longest

    while True:
        try:
            call = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        child = os.fork()
        if child == 0:
            answer(*call)
            sys.stderr.flush()
            os._exit(0)
        print(os.waitpid(child, 0)[1], flush=True)


def answer(file: str, name: str, arguments: bytes, env: dict[str, str], output: str) -> None:
    """Calls what it is told to and writes down what came of it."""
    os.environ.update(env)
    try:
        outcome = (True, function(file, name)(**pickle.loads(arguments)))
    except Exception as error:
        outcome = (False, f"{type(error).__name__}: {error}")
    Path(output).write_bytes(pickle.dumps(outcome))


def function(file: str, name: str) -> Callable[..., Any]:
    """A function by the file of its module and its name."""
    stem = Path(file).stem
    if stem not in sys.modules:
        spec = importlib.util.spec_from_file_location(stem, file)
        if spec is None or spec.loader is None:
            raise ImportError(file)
        sys.modules[stem] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[stem])
    return getattr(sys.modules[stem], name)  # type: ignore[no-any-return]


if __name__ == "__main__":
    main()
