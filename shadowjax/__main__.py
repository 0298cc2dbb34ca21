"""`python -m shadowjax` is the command `shadowjax`; signals are handled before the rest is imported."""

from typing import NoReturn

from shadowjax import _process


def _main() -> int:
    from shadowjax.cli import main

    return main()


def run() -> NoReturn:
    """Run the command line as the whole of this process."""
    _process.run("shadowjax", _main)


if __name__ == "__main__":
    run()
