"""What any controller in Python needs to be a process of a morphquad run, in lockstep and in realtime.

A controller file imports this first, defines a law, and ends with `attitude.main` or `position.main`.
`launcher/docs/controllers.md` has the rules that the modules here follow.
"""

import os
import sys

UNFIT = 3
# Of the folder with the controllers, whose virtual environment is used if there is one.
FOLDER = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))


def _refuse(reason):
    print(os.path.basename(sys.argv[0]) + ": " + reason, file=sys.stderr)
    sys.exit(UNFIT)


def _find_packages():
    """A controller that is started by its path need not have activated its environment."""
    if sys.version_info < (3, 11):
        version = sys.version.split()[0]
        _refuse("it needs Python 3.11 or newer and this is " + version + ": install a newer python3")
    try:
        import iceoryx2  # noqa: F401
    except ImportError:
        environment = os.path.join(FOLDER, ".venv")
        python = os.path.join(environment, "bin", "python")
        if os.path.exists(python) and os.path.realpath(sys.prefix) != os.path.realpath(environment):
            os.execv(python, [python] + sys.argv)
        requirements = os.path.join(FOLDER, "requirements.txt")
        _refuse(
            "the package iceoryx2 is missing in " + sys.executable + ": run `python3 -m venv "
            + environment + " && " + python + " -m pip install -r " + requirements + "`"
        )


_find_packages()
