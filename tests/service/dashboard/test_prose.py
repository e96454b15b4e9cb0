"""The part of Markdown in which an organiser writes rules."""

from __future__ import annotations

import pytest

from tests.service.browsing import Visitor

TEXTS = {
    "a list after text": ("Each team:\n- one\n- two", "<p>Each team:</p><ul><li>one</li><li>two</li></ul>"),
    "items of two lines": (
        "1. no other data\n   than the set\n2. b",
        "<ol><li>no other data than the set</li><li>b</li></ol>",
    ),
    "a list that goes on": ("3. c\n\nText", '<ol start="3"><li>c</li></ol><p>Text</p>'),
    "a year after text": ("in the year\n2026. Then", "<p>in the year 2026. Then</p>"),
    "code": (
        "See:\n```sh\n# no *heading*\n\n- x\n```\nEnd",
        '<p>See:</p><pre tabindex="0"><code># no *heading*\n\n- x</code></pre><p>End</p>',
    ),
    "code without an end": ("```\n<b>x</b>", '<pre tabindex="0"><code>&lt;b&gt;x&lt;/b&gt;</code></pre>'),
    "HTML": (
        "# <i>A</i>\n- <img src=x>\n  <b>",
        "<h3>&lt;i&gt;A&lt;/i&gt;</h3><ul><li>&lt;img src=x&gt; &lt;b&gt;</li></ul>",
    ),
    "inline": (
        "`a` **b** [c](https://x.org) [d](js:e)",
        '<p><code>a</code> <b>b</b> <a href="https://x.org" rel="noopener noreferrer nofollow">c</a> [d](js:e)</p>',
    ),
    "lines": ("\r\n\r\na\r\nb\r\n \r\nc\r\n", "<p>a b</p><p>c</p>"),
}  # fmt: skip


@pytest.mark.parametrize(("text", "html"), TEXTS.values(), ids=TEXTS)
def test_rules_are_shown(visit: Visitor, text: str, html: str) -> None:
    page = visit().go("/login")
    found = page.evaluate("async text => (await import('/static/prose.js')).prose(text).innerHTML", text)
    assert found == html
