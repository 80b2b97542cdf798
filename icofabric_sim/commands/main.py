# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""
Entry point of `icofabric`: finds the verb, and turns what goes wrong into an exit status.

Each verb is a module with `add_arguments(parser)` and `main(arguments) -> int`. Only the module of
the verb that was asked for is imported, and what takes long to import only when it is needed: an
interrupt before `main` is called ends Python as it likes.
"""

import argparse
from importlib import import_module
import os
import signal
import sys
import threading
from typing import Any, NoReturn

# Verb, and what it does; the module has the same name.
VERBS = {
    'run': 'simulate a scene as fast as possible and record it to a bag',
    'verify': 'simulate a recorded run again and compare, bit by bit',
    'statics': 'find where a scene comes to rest under its loads',
    'modes': 'find the small vibrations and the mechanisms of a scene',
    'elasticity': 'find the elastic constants of a fabric, and stress against strain of its slab',
    'info': 'describe a scene or a recorded run',
    'render': 'draw a recorded run to pictures',
    'plot': 'plot energies, displacements, forces, tensions, spectra or stress of a recorded run',
    'film': 'film a recorded run or a scene: MP4, WebP or GIF',
    'view': 'look at a scene or a recorded run in a browser, and pull at it',
    'sweep': 'run a scene for many values of its parameters, on all cores or a cluster',
    'study': 'answer what kind of material it is: all figures and tables of docs/study.md',
    'document': 'print the tables and the appendix of the document, and draw its figures',
    'tables': 'print the tables of the document, and draw its Figure 5 (see document)',
    'stress': 'judge random scenes: accuracy, stability, refusals, bits',
    'benchmark': 'measure speed and accuracy beside other tools',
    'new': 'write a commented scene to begin with',
    'completion': 'print a script that completes verbs, options and scenes in a shell',
    'warm': 'compile kernels ahead, so that runs begin at once',
    'recover': 'make a whole bag of one whose recorder was killed',
}
# Verbs of the sibling package icofabric_validation, which declares them as entry points.
VALIDATION_VERBS = ('study', 'stress', 'benchmark')
DONE, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
# Wall time [s] after which an interrupt that was dropped is sent once more.
_AGAIN = 0.05


class _Help(argparse.HelpFormatter):
    """Keeps every verb on the line of its summary: argparse counts their indent too short."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog)
        self._action_max_length = max(map(len, VERBS)) + 4


class _Parser(argparse.ArgumentParser):
    """Says in one line what is wrong."""

    def error(self, message: str) -> NoReturn:
        import difflib
        import re
        wrong = re.match(r"argument VERB: invalid choice: '([^']+)'", message)
        near = difflib.get_close_matches(wrong[1], VERBS, 1) if wrong else []
        if wrong and near:
            message = f'there is no verb {wrong[1]}; did you mean {near[0]}?'
        print(f'{self.prog}: {message} (see {self.prog} --help)', file=sys.stderr)
        sys.exit(BAD_INPUT)


def main(argv: list[str] | None = None) -> int:
    """
    Run one verb; without `argv` that of the command line, after which the process is to end.

    Returns 0: done; 1: the physics or the file says no; 2: bad input; 130: interrupted.
    """
    words = sys.argv[1:] if argv is None else argv
    name = f'icofabric {words[0]}' if words and words[0] in VERBS else 'icofabric'
    signal.signal(signal.SIGTERM, _interrupt)
    if argv is None:
        sys.unraisablehook = _raise_again
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        # A shell has its background jobs ignore it; whoever sends it means it.
        signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        try:
            return _guarded(words, name)
        finally:
            if argv is None:
                _ignore_interrupts()
    except KeyboardInterrupt:
        if argv is None:
            _ignore_interrupts()
        # Where it was raised in a text that `exec` or `eval` runs (named tuples are made so),
        # Python notes that, and in the end kills itself by SIGINT whatever the status. The next
        # text resets the note.
        exec('')
        print(f'{name}: interrupted', file=sys.stderr)
        return INTERRUPTED


def load_verb(verb: str) -> Any:
    """Import the module of a verb. Raise InputError if its package is not installed."""
    if verb not in VALIDATION_VERBS:
        return import_module(f'icofabric_sim.commands.{verb}')
    from importlib.metadata import entry_points
    for entry in entry_points(group='icofabric_sim.commands', name=verb):
        return entry.load()
    from icofabric_sim.libraries import install_command
    from icofabric_sim.terminal import InputError
    command = install_command('icofabric_validation')
    raise InputError(
        f'this verb needs icofabric_validation, which is not installed; in a clone: {command}')


def _guarded(words: list[str], name: str) -> int:
    """Run a verb; what goes wrong, but for an interrupt, becomes a line and a status."""
    from icofabric_sim.libraries import install_command, MissingLibrary
    from icofabric_sim.terminal import FileSaysNo, InputError
    try:
        status = _run(words)
        sys.stdout.flush()
        return status
    except (InputError, MissingLibrary) as error:
        print(f'{name}: {_one_line(error)}', file=sys.stderr)
        return BAD_INPUT
    except ModuleNotFoundError as error:
        module = (error.name or '').partition('.')[0]
        if module in ('', 'icofabric_sim'):
            raise
        print(f'{name}: {module} is not installed: {install_command(module)}', file=sys.stderr)
        return BAD_INPUT
    except FileSaysNo as error:
        print(f'{name}: {error}', file=sys.stderr)
        return FAILED
    except BrokenPipeError:
        # The reader of the output closed it; Python must not complain at its end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return DONE
    except MemoryError:
        print(f'{name}: there is not enough memory for this; choose less', file=sys.stderr)
        return FAILED
    except OSError as error:
        place = f'{error.filename}: ' if error.filename else ''
        print(f'{name}: {place}{error.strerror or error}', file=sys.stderr)
        return FAILED


def _run(words: list[str]) -> int:
    parser = _Parser(
        prog='icofabric',
        description='Simulate icosahedral fabric without a ROS graph.',
        formatter_class=_Help,
        epilog='icofabric VERB --help explains a verb.')
    from icofabric_sim.commands.scenes import located
    from icofabric_sim.terminal import InputError, quiet
    from icofabric_sim.version import __version__
    parser.add_argument('--version', action='version', version=f'icofabric_sim {__version__}')
    verbs = parser.add_subparsers(dest='verb', metavar='VERB', required=True)
    # For a word that is not a verb the names are enough.
    wanted = next((word for word in words if not word.startswith('-')), '')
    for verb, summary in VERBS.items():
        sub = verbs.add_parser(
            verb, help=summary, description=f'{summary[0].upper()}{summary[1:]}.')
        if verb == wanted:
            module = load_verb(verb)
            module.add_arguments(sub)
            sub.add_argument(
                '-q', '--quiet', action='store_true',
                help='show results, warnings and errors only, no progress')
            sub.set_defaults(main=module.main)
    if wanted in VERBS:
        # Words that are left over are reported with the verb.
        parser.prog = f'icofabric {wanted}'
    arguments = parser.parse_args(words)
    try:
        with quiet(arguments.quiet):
            return int(arguments.main(arguments))
    except InputError as error:
        given = getattr(arguments, 'parameter', None) or []
        raise located(error, getattr(arguments, 'scene', ''), given) from error


def _one_line(error: Exception) -> str:
    # A name of a file may have line breaks.
    return ' '.join(str(error).splitlines())


def _interrupt(number: int, frame: object) -> NoReturn:
    raise KeyboardInterrupt


def _raise_again(lost: 'sys.UnraisableHookArgs') -> None:
    """
    Send an interrupt once more that was raised where nothing can catch it.

    Such as the compiler's calls back into Python, which drop it, or a `__del__`.
    """
    if lost.exc_type is not KeyboardInterrupt:
        sys.__unraisablehook__(lost)
        return
    again = threading.Timer(_AGAIN, os.kill, (os.getpid(), signal.SIGINT))
    again.daemon = True
    again.start()


def _ignore_interrupts() -> None:
    """
    Let the process end with the status that is decided.

    While Python tears its modules down signals have their default action again, and would kill it.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)


if __name__ == '__main__':
    sys.exit(main())
