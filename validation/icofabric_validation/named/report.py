# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Table of the results of problems with known answers."""

from collections.abc import Iterable
import csv
from pathlib import Path
from typing import Any, Final

from icofabric_validation.named.problem import Answer, Curve, Problem

COLUMNS: Final = (
    'problem', 'name', 'curve', 'refined', 'value', 'error', 'steps', 'order', 'expected',
    'allowed', 'fault')
_HEAD = f'{"no":>2} {"curve":36}{"refined":22}{"value":>10}{"error":>10}{"steps":>9}{"order":>7}'


def catalogue_lines(problems: Iterable[Problem]) -> list[str]:
    """Return a line for each problem."""
    return [
        f'{number:3}  {problem.name:22} {problem.title}'
        + (' (also long)' if problem.has_long_form else '')
        for number, problem in enumerate(problems, 1)]


def head_lines() -> list[str]:
    """Return the head of the table."""
    return [_HEAD, '-' * len(_HEAD)]


def answer_lines(answer: Answer) -> list[str]:
    """Return the rows of a problem: compared quantity, errors, orders and expectations."""
    problem = answer.problem
    lines = [f'{answer.number:2} {problem.name}: {problem.title}',
             f'   error: {problem.compared}']
    for curve in answer.curves:
        for index, point in enumerate(curve.points):
            order = curve.order_before(index)
            lines.append(
                f'   {curve.label if index == 0 else "":36}'
                f'{curve.refined if index == 0 else "":22}{point.refined:10.4g}{point.error:10.2g}'
                f'{point.steps or "":>9}' + ('' if order is None else f'{order:7.2f}'))
        lines.append(f'   {"":36}{_judgement(curve)}')
    if answer.failure:
        lines.append(f'   {answer.failure}')
    return lines


def _judgement(curve: Curve) -> str:
    """Return the expectation for a curve, and its result."""
    if curve.is_comparison:
        return 'for comparison, not judged'
    words = f'at most {curve.allowed:.2g}'
    if curve.order is not None:
        slope = curve.observed_order
        words += f', order {curve.order:g}'
        words += '' if slope is None else f' (slope {slope:.2f})'
    return f'{words}: {curve.fault or "as expected"}'


def summary_line(answers: Iterable[Answer]) -> str:
    """Return the number of problems with the expected answer."""
    found = list(answers)
    wrong = [str(answer.number) for answer in found if answer.faults]
    line = f'{len(found) - len(wrong)} of {len(found)} problems answered as expected'
    return f'{line}; not {", ".join(wrong)}' if wrong else line


def as_dictionary(answer: Answer) -> dict[str, Any]:
    """Return an answer as plain values, for JSON."""
    problem = answer.problem
    return {
        'problem': answer.number, 'name': problem.name, 'title': problem.title,
        'source': problem.source, 'compared': problem.compared, 'seconds': answer.seconds,
        'faults': answer.faults,
        'curves': [
            {'curve': curve.label, 'refined': curve.refined, 'allowed': curve.allowed,
             'expected_order': curve.order, 'order': curve.observed_order,
             'comparison': curve.is_comparison, 'fault': curve.fault,
             'points': [point._asdict() for point in curve.points]}
            for curve in answer.curves]}


def write_table(path: Path, answers: Iterable[Answer]) -> None:
    """Write a CSV with a line for each point."""
    with path.open('w', newline='', encoding='utf-8') as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for answer in answers:
            for curve in answer.curves:
                for index, point in enumerate(curve.points):
                    writer.writerow([
                        answer.number, answer.problem.name, curve.label, curve.refined,
                        repr(point.refined), repr(point.error), point.steps,
                        curve.order_before(index), curve.order, curve.allowed, curve.fault])
            if answer.failure:
                writer.writerow([
                    answer.number, answer.problem.name, *[''] * 8, answer.failure])
