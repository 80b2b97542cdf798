# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Who may open the page: Host and Origin headers, and the token where it is not only local."""

from icofabric_sim.viewer.guard import Guard
import pytest

LOCAL = {'Host': 'localhost:8080'}


@pytest.mark.parametrize('headers', [
    LOCAL, {'Host': '127.0.0.1:8080'}, {'Host': '[::1]:8080'},
    {**LOCAL, 'Origin': 'http://localhost:8080'},
    # A tunnel has a port of its own.
    {'Host': 'localhost:28106', 'Origin': 'http://localhost:28106'}, {'Host': 'localhost'}])
def test_page_of_this_machine_is_let_in(headers):
    assert Guard('127.0.0.1').judge('/', headers) == ''


@pytest.mark.parametrize(('headers', 'words'), [
    ({}, 'Host'), ({'Host': 'evil.example:8080'}, 'Host'), ({'Host': 'localhost:'}, 'Host'),
    ({'Host': 'localhost.evil.example:8080'}, 'Host'),
    ({'Host': 'localhost:8080.evil.example'}, 'Host'),
    ({**LOCAL, 'Origin': 'http://localhost:3000'}, 'Origin'),
    ({**LOCAL, 'Origin': 'http://evil.example'}, 'Origin'),
    ({**LOCAL, 'Origin': 'https://localhost:8080'}, 'Origin'),
    ({**LOCAL, 'Origin': 'http://127.0.0.1:8080'}, 'Origin'),
    ({**LOCAL, 'Origin': 'null'}, 'Origin')])
def test_other_pages_are_refused(headers, words):
    assert words in Guard('127.0.0.1').judge('/', headers)


def test_elsewhere_a_token_is_asked_for():
    guard, headers = Guard('0.0.0.0'), {'Host': 'robot:8080'}
    assert 'token' in guard.judge('/', headers)
    assert 'token' in guard.judge('/?token=x', headers)
    assert 'token' in guard.judge('/', {**headers, 'Cookie': 'icofabric_viewer=x'})
    assert guard.judge(f'/?token={guard.token}', headers) == ''
    cookie = guard.cookie_for(f'/?token={guard.token}')
    assert 'HttpOnly' in cookie and 'SameSite=Strict' in cookie
    headers['Cookie'] = cookie.partition(';')[0]
    assert guard.judge('/', headers) == ''
    assert 'Origin' in guard.judge('/', {**headers, 'Origin': 'http://evil.example'})
    assert guard.cookie_for('/') == '' and Guard('0.0.0.0').token != guard.token
    assert Guard('localhost').cookie_for('/?token=') == ''


def test_nothing_is_served_unguarded():
    pytest.importorskip('websockets')
    with pytest.raises(RuntimeError, match='not served'), Guard('127.0.0.1').installed():
        pass
