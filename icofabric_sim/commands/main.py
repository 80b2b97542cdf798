# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Entry point of `icofabric`: find the verb, and map errors to exit statuses.

Each verb is a module with `add_arguments(parser)` and `main(arguments) -> int`. Only the requested
module is imported, and slow imports are deferred until needed. An interrupt before `main` is
called ends Python in its default way.
"""

import argparse
from importlib import import_module
import os
import signal
import sys
import threading
from typing import Any, NoReturn

# Verbs and their summaries; each module is named like its verb.
VERBS = {
    'run': 'simulate a scene as fast as possible and record it to a bag',
    'verify': 'simulate a recorded run again and compare, bit by bit',
    'statics': 'find the static equilibrium of a scene under its loads',
    'modes': 'find normal modes and mechanisms of a scene',
    'elasticity': 'find elastic constants of a fabric, and stress-strain curves of a slab',
    'info': 'describe a scene or a recorded run',
    'render': 'draw a recorded run to pictures',
    'plot': 'plot energies, displacements, forces, tensions, spectra or stress of a recorded run',
    'film': 'film a recorded run or a scene: MP4, WebP or GIF',
    'view': 'show a scene or a recorded run in a browser, and drag its shells',
    'sweep': 'run a scene for many parameter values, on all cores or a cluster',
    'study': 'compute the material study: all figures and tables of docs/study.md',
    'document': 'print the tables and the appendix of the document, and draw its figures',
    'tables': 'print the tables of the document, and draw its Figure 5 (see document)',
    'stress': 'test random scenes: accuracy, stability, input validation, reproducibility',
    'benchmark': 'measure speed and accuracy, and compare with other tools',
    'new': 'write a new scene file with comments',
    'completion': 'print a shell completion script for verbs, options and scenes',
    'warm': 'compile kernels in advance, so that runs start at once',
    'recover': 'recover a bag whose recorder was killed',
}
# Verbs of the sibling package icofabric_validation, which declares them as entry points.
VALIDATION_VERBS = ('study', 'stress', 'benchmark')
DONE, FAILED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
# Wall time [s] after which a dropped interrupt is raised again.
_RETRY_S = 0.05


class _Help(argparse.HelpFormatter):
    """Help formatter that keeps a verb and its summary on one line."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog)
        self._action_max_length = max(map(len, VERBS)) + 4


class _Parser(argparse.ArgumentParser):
    """Argument parser that reports an error in one line."""

    def error(self, message: str) -> NoReturn:
        import difflib
        import re
        wrong = re.match(r"argument VERB: invalid choice: '([^']+)'", message)
        near = difflib.get_close_matches(wrong[1], VERBS, 1) if wrong else []
        if wrong and near:
            message = f'unknown verb {wrong[1]}; did you mean {near[0]}?'
        print(f'{self.prog}: {message} (see {self.prog} --help)', file=sys.stderr)
        sys.exit(BAD_INPUT)


def main(argv: list[str] | None = None) -> int:
    """
    Run the verb in `argv` (default: `sys.argv`).

    Without `argv`, SIGINT and SIGTERM are ignored after the verb ends; the caller should exit.

    Return the exit status: 0 done, 1 failed run or damaged file, 2 bad input, 130 interrupted.
    """
    words = sys.argv[1:] if argv is None else argv
    name = f'icofabric {words[0]}' if words and words[0] in VERBS else 'icofabric'
    signal.signal(signal.SIGTERM, _interrupt)
    if argv is None:
        sys.unraisablehook = _raise_again
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        # A shell starts background jobs with this signal ignored.
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
        # If the interrupt was raised in code run by `exec` or `eval` (named tuples are built so),
        # Python records that and kills itself by SIGINT at the end, whatever the status. Another
        # such run resets the record.
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
    """Run a verb; map every error except an interrupt to a message and an exit status."""
    from icofabric_sim.libraries import install_command, MissingLibrary
    from icofabric_sim.terminal import CommandFailed, InputError
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
    except CommandFailed as error:
        print(f'{name}: {error}', file=sys.stderr)
        return FAILED
    except BrokenPipeError:
        # The reader closed the pipe; Python must not report that at its end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return DONE
    except MemoryError:
        print(f'{name}: not enough memory; choose a smaller problem', file=sys.stderr)
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
        epilog='icofabric VERB --help describes the options of a verb.')
    from icofabric_sim.commands.scenes import located
    from icofabric_sim.terminal import InputError, quiet
    from icofabric_sim.version import __version__
    parser.add_argument('--version', action='version', version=f'icofabric_sim {__version__}')
    verbs = parser.add_subparsers(dest='verb', metavar='VERB', required=True)
    # Names are sufficient for a word that is not a verb.
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
        # Report remaining words in the name of the verb.
        parser.prog = f'icofabric {wanted}'
    arguments = parser.parse_args(words)
    try:
        with quiet(arguments.quiet):
            return int(arguments.main(arguments))
    except InputError as error:
        given = getattr(arguments, 'parameter', None) or []
        raise located(error, getattr(arguments, 'scene', ''), given) from error


def _one_line(error: Exception) -> str:
    # A file name may contain line breaks.
    return ' '.join(str(error).splitlines())


def _interrupt(number: int, frame: object) -> NoReturn:
    raise KeyboardInterrupt


def _raise_again(lost: 'sys.UnraisableHookArgs') -> None:
    """
    Raise an interrupt again that was raised where nothing can catch it.

    Examples are callbacks of the compiler, which drop it, or a `__del__`.
    """
    if lost.exc_type is not KeyboardInterrupt:
        sys.__unraisablehook__(lost)
        return
    again = threading.Timer(_RETRY_S, os.kill, (os.getpid(), signal.SIGINT))
    again.daemon = True
    again.start()


def _ignore_interrupts() -> None:
    """
    Ignore interrupts, so that the process ends with its exit status.

    While Python tears down its modules, signals have their default action again and would kill it.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)


if __name__ == '__main__':
    sys.exit(main())
