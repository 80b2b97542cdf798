# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""`icofabric completion SHELL`."""

import argparse
from contextlib import suppress

from icofabric_sim.commands.main import load_verb, VERBS
from icofabric_sim.parameters.example_scenes import example_scenes
from icofabric_sim.terminal import InputError

# The options of each verb are listed once, when the script is generated.
_BASH = """\
# Completion of icofabric for bash: eval "$(icofabric completion bash)"
_icofabric() {{
    local word="${{COMP_WORDS[COMP_CWORD]}}" verb="${{COMP_WORDS[1]}}" words=""
    if [ "$COMP_CWORD" -eq 1 ]; then
        words="{verbs} --help --version"
    else
        case "$verb" in
{cases}
        esac
    fi
    COMPREPLY=($(compgen -W "$words" -- "$word") $(compgen -f -- "$word"))
}}
complete -o filenames -F _icofabric icofabric
"""
_ZSH = """\
# Completion of icofabric for zsh: eval "$(icofabric completion zsh)"
autoload -Uz compinit && compinit
autoload -Uz bashcompinit && bashcompinit
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the verb."""
    parser.add_argument(
        'shell', choices=('bash', 'zsh', 'fish'),
        help='bash, zsh: eval "$(icofabric completion SHELL)" in its start file; fish: icofabric '
             'completion fish > ~/.config/fish/completions/icofabric.fish')


def main(arguments: argparse.Namespace) -> int:
    """Print the completion script."""
    print({'bash': bash_script, 'zsh': lambda: _ZSH + bash_script(), 'fish': fish_script}[
        arguments.shell](), end='')
    return 0


def words_of(verb: str) -> tuple[list[str], bool]:
    """Return the options of a verb, and whether it takes a scene."""
    parser = argparse.ArgumentParser()
    load_verb(verb).add_arguments(parser)
    options = [option for action in parser._actions for option in action.option_strings
               if option.startswith('--')]
    scene = any(action.dest in ('scene', 'scenes') for action in parser._actions)
    choices = [str(choice) for action in parser._actions
               if action.choices and not action.option_strings for choice in action.choices]
    return [*choices, *options, '--quiet'], scene


def installed_verbs() -> dict[str, str]:
    """Return the verbs whose package is installed, with their summaries."""
    found = {}
    for verb, summary in VERBS.items():
        with suppress(InputError):
            load_verb(verb)
            found[verb] = summary
    return found


def bash_script() -> str:
    """Return the script for bash."""
    cases = []
    verbs = installed_verbs()
    for verb in verbs:
        options, scene = words_of(verb)
        words = [*(example_scenes() if scene else ()), *options]
        cases.append(f'        {verb}) words="{" ".join(words)}" ;;')
    return _BASH.format(verbs=' '.join(verbs), cases='\n'.join(cases))


def fish_script() -> str:
    """Return the script for fish."""
    lines = ['# Completion of icofabric for fish']
    for verb, summary in installed_verbs().items():
        lines.append(
            f"complete -c icofabric -n __fish_use_subcommand -f -a {verb} -d '{summary}'")
        options, scene = words_of(verb)
        seen = f"-n '__fish_seen_subcommand_from {verb}'"
        for option in options:
            word = f'-l {option[2:]}' if option.startswith('--') else f'-a {option}'
            lines.append(f'complete -c icofabric {seen} {word}')
        if scene:
            lines.append(f"complete -c icofabric {seen} -a '{' '.join(example_scenes())}'")
    return '\n'.join(lines) + '\n'
