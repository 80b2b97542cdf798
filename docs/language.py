# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Count what docs/style.md asks of names, docstrings, messages and pages.

    .venv/bin/python docs/language.py --rooms

One line for each rule: its count and the number of places examined. `--list` prints the places,
`--rooms` the counts by room of the package and by page.
"""

import argparse
import ast
from collections import Counter
from pathlib import Path
import re
import subprocess
from typing import Iterator, NamedTuple

BAD_FIRST = set(
    'Whether What How Where Who Whom When Have Has Of As That So If None Its It They There Here '
    'Likewise'.split())
VAGUE = re.compile(
    r'^_?(MOST|LEAST|FEW|MANY|LONG|LONGEST|SHORT|SHORTEST|LARGE|LARGEST|SMALL|SMALLEST|ROOM|WAY|'
    r'WAYS|LOOK|LOOKS|NEAR|FAR|KEPT|KNOWN|STEADY|GOOD|TAKEN|PATIENCE|PIECE|PART|PUSH|EAGER|AWAY|D|'
    r'WORD|SAME|ROWS|SLOW|QUICK|TRIES|ON_FACE|AIM|MEANT|UNCOUNTED|CERTAIN|LIVELIER|ROUNDED|'
    r'ZERO)$')
ODD = re.compile(
    r'\b(somebody|nobody|whoever|begin(s|ning)? anew|goes on|go on by|taken back|put elsewhere|'
    r'(?-i:(?<!there )is none|are none)|as it is|by itself|beside (it|that|each|others)|'
    r'(is|are) said|'
    r'(is|are) told|(is|are) asked|(is|are) of (a|the|no)\b|of (its|their) own|'
    r'(of|from|by|with|to|for) what (touches|follows|is|was|acts|a|the)\b|'
    r'^\W*what (touches|follows|is|was|acts|a|the)\b|from nothing|so many|all else|'
    r'what becomes of|in vain|makes of|here and there|mend(s|ed)?)\b', re.I)
LONGEST_SENTENCE, LONGEST_SUBJECT = 35, 70
RULES = ('docstrings', 'sections', 'constants', 'sentences', 'words', 'commits')
PACKAGES = ('icofabric_sim', 'validation/icofabric_validation')


class Place(NamedTuple):
    """A breach of a rule."""

    rule: str
    path: Path
    text: str


class Counts(NamedTuple):
    """Breaches, the number of places examined by rule, and the words of each sentence by page."""

    places: list[Place]
    examined: Counter[str]
    lengths: dict[Path, list[int]]

    @property
    def mean_length(self) -> float:
        """Mean number of words in a sentence of all pages."""
        every = [length for page in self.lengths.values() for length in page]
        return sum(every) / max(len(every), 1)


def count(root: Path) -> Counts:
    """Count all rules in a checkout."""
    counts = Counts([], Counter(), {})
    public = public_names(root)
    for path in python_files(root):
        examine_code(counts, path, public)
    for path in pages(root):
        examine_page(counts, path)
    examine_commits(counts, root)
    return counts


def python_files(root: Path) -> list[Path]:
    """Return the modules of all packages."""
    return [path for top in PACKAGES for path in sorted((root / top).rglob('*.py'))]


def pages(root: Path) -> list[Path]:
    """Return README and the pages outside docs/decisions."""
    return [root / 'README.md', *(
        path for path in sorted((root / 'docs').rglob('*.md')) if 'decisions' not in path.parts)]


def public_names(root: Path) -> dict[str, Path]:
    """Return the names that the package exports, and the module of each."""
    tree = ast.parse((root / 'icofabric_sim/__init__.py').read_text())
    return {
        alias.name: (root / node.module.replace('.', '/')).with_suffix('.py')
        for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module
        and node.module.startswith('icofabric_sim.') for alias in node.names}


def examine_code(counts: Counts, path: Path, public: dict[str, Path]) -> None:
    """Count the rules for docstrings, messages and constants of a module."""
    tree = ast.parse(path.read_text())
    # Texts that stand alone are docstrings, which are counted with their functions.
    alone = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
            doc = ast.get_docstring(node)
            if public.get(node.name) == path:
                examine_sections(counts, path, node)
            if doc:
                counts.examined['docstrings'] += 1
                if doc.split()[0].strip(',.:') in BAD_FIRST or doc.startswith('The same'):
                    add(counts, 'docstrings', path, node, f'{node.name}: {doc.splitlines()[0]}')
                if odd := ODD.search(doc):
                    add(counts, 'words', path, node, f'{odd.group(0)!r} in {doc.splitlines()[0]}')
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and (
                id(node) not in alone):
            odd = ODD.search(node.value)
            if odd and '\n' not in node.value and len(node.value.split()) > 3:
                add(counts, 'words', path, node, f'{odd.group(0)!r} in {node.value!r}')
    for statement in tree.body:
        targets = statement.targets if isinstance(statement, ast.Assign) else [
            statement.target] if isinstance(statement, ast.AnnAssign) else []
        for target in targets:
            for name, value in paired(target, statement.value):
                if isinstance(name, ast.Name) and name.id.isupper():
                    counts.examined['constants'] += 1
                    # A constant for a word, such as PUSH = 'push', is named by this word.
                    if VAGUE.match(name.id) and not (
                            isinstance(value, ast.Constant) and value.value == name.id.lower()):
                        add(counts, 'constants', path, statement, name.id)


def paired(
    target: ast.expr, value: ast.expr | None
) -> list[tuple[ast.expr, ast.expr | None]]:
    """Return the targets of an assignment with their values; None: not known from the source."""
    if not isinstance(target, ast.Tuple):
        return [(target, value)]
    if isinstance(value, ast.Tuple) and len(value.elts) == len(target.elts):
        return list(zip(target.elts, value.elts))
    return [(name, None) for name in target.elts]


def examine_sections(
    counts: Counts, path: Path, node: ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef
) -> None:
    """Count public functions, and methods with arguments, that do not describe parameters."""
    functions = [node] if not isinstance(node, ast.ClassDef) else [
        method for method in node.body if isinstance(method, ast.FunctionDef)
        and not method.name.startswith('_') and len(method.args.args) > 1]
    for function in functions:
        counts.examined['sections'] += 1
        doc = ast.get_docstring(function) or ''
        if not re.search(r'^\s*Parameters\s*\n\s*-', doc, re.M):
            add(counts, 'sections', path, function, f'{node.name}.{function.name}')


def examine_page(counts: Counts, path: Path) -> None:
    """Count long sentences and cells and the phrases of a page."""
    text = path.read_text()
    for cell in re.findall(r'(?<=\|)[^|\n]+(?=\|)', text):
        if len(cell.split()) > LONGEST_SENTENCE:
            counts.places.append(Place(
                'sentences', path, f'cell of {len(cell.split())} words: {cell.strip()}'))
    lengths = counts.lengths.setdefault(path, [])
    for words, sentence in sentences(text):
        lengths.append(words)
        counts.examined['sentences'] += 1
        if words > LONGEST_SENTENCE:
            counts.places.append(Place('sentences', path, f'{words} words: {sentence}'))
    for number, line in enumerate(without_code(text).splitlines(), 1):
        for odd in ODD.finditer(line):
            counts.places.append(Place('words', path, f'line {number}: {odd.group(0)!r}'))


def without_code(text: str) -> str:
    """Return a page with empty lines for those of code and output."""
    text = re.sub(r'```.*?```', lambda code: '\n' * code.group(0).count('\n'), text, flags=re.S)
    return re.sub(r'^( {4}|\t).*$', '', text, flags=re.M)


def sentences(text: str) -> Iterator[tuple[int, str]]:
    """Yield the sentences of more than three words, with their numbers of words."""
    text = without_code(text)
    text = re.sub(r'^\|.*$|^#.*$|^!\[.*$|^\s*[-*] ', '\n', text, flags=re.M)
    text = re.sub(r'\[([^\]]*)\]\([^)]*\)', r'\1', re.sub(r'`[^`]*`', 'X', text))
    for block in re.split(r'\n\s*\n', text):
        for sentence in re.split(r'(?<=[.!?])\s+', ' '.join(block.split())):
            if (words := len(sentence.split())) > 3:
                yield words, sentence


def examine_commits(counts: Counts, root: Path) -> None:
    """Count the subjects of the last 100 commits that are long or no imperatives."""
    log = subprocess.run(
        ['git', '-C', root, 'log', '-100', '--format=%s'], capture_output=True, text=True)
    for subject in log.stdout.splitlines():
        counts.examined['commits'] += 1
        if len(subject) > LONGEST_SUBJECT or subject.split()[0] in BAD_FIRST:
            counts.places.append(Place('commits', root, subject))


def add(counts: Counts, rule: str, path: Path, node: ast.stmt | ast.expr, text: str) -> None:
    """Add a breach at a line of a module."""
    counts.places.append(Place(rule, path, f'line {node.lineno}: {text}'))


def main() -> None:
    """Print the counts."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('root', nargs='?', type=Path, default=Path(__file__).resolve().parents[1])
    parser.add_argument('--list', choices=RULES, help='print the places')
    parser.add_argument('--max', type=int, default=60, help='print at most this many')
    parser.add_argument('--rooms', action='store_true', help='print counts by room and page')
    options = parser.parse_args()
    root = options.root.resolve()
    counts = count(root)
    if options.list:
        for place in [each for each in counts.places if each.rule == options.list][:options.max]:
            print(f'{place.path.relative_to(root)}: {place.text[:120]}')
        return
    if options.rooms:
        by_room: dict[str, Counter[str]] = {}
        for place in counts.places:
            parts = place.path.relative_to(root).parts
            room = '/'.join(parts[:2]) if parts[:1] != ('docs',) else '/'.join(parts)
            by_room.setdefault(room, Counter())[place.rule] += 1
        for room, found in sorted(by_room.items()):
            print(f'{room}:', ', '.join(f'{found[rule]} {rule}' for rule in RULES if found[rule]))
        return
    found = Counter(place.rule for place in counts.places)
    for rule in RULES:
        print(f'{rule}: {found[rule]} of {counts.examined[rule] or "all lines"}')
    print(f'mean sentence of the pages: {counts.mean_length:.1f} words')
    print(f'pages outside decisions: {sum(len(page.read_text().split()) for page in pages(root))} '
          'words')
    for package in PACKAGES:
        print(f'{package}: {statements(root / package)} statements without docstrings')


def statements(folder: Path) -> int:
    """Return the number of statements in a folder, without docstrings."""
    return sum(
        isinstance(node, ast.stmt)
        and not (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant))
        for path in folder.rglob('*.py') for node in ast.walk(ast.parse(path.read_text())))


if __name__ == '__main__':
    main()
