"""The command line of dynid: `python -m dynid`, or `dynid` where the package is installed."""

import signal
import sys

from dynid._dynid import main as _main


def main() -> int:
    """Runs the command that was typed; its exit status."""
    # Ctrl-C is heard by the program itself.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    return _main(["dynid", *sys.argv[1:]], [sys.executable, "-m", "dynid"])


if __name__ == "__main__":
    sys.exit(main())
