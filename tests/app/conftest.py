"""A server of the explorer and windows of a browser, which tests of the page share."""

from __future__ import annotations

import pytest


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    """The explorer on two corridors."""
    from support.explorer_page import corridors, serve

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("LOCPLAN_CACHE", str(tmp_path_factory.getbasetemp() / "cache"))
        with serve(*corridors(), folder=tmp_path_factory.mktemp("written")) as explorer:
            yield explorer


@pytest.fixture
def visit(browser, server):
    """Open the page in a window of its own; at the end nothing may have gone wrong."""
    from support.explorer_page import Seen, is_ours

    contexts, pages = [], []

    def opened(address=None, permissions=(), **options):
        options = {"viewport": {"width": 1200, "height": 800}} | options
        contexts.append(browser.new_context(**options))
        contexts[-1].grant_permissions(list(permissions))
        pages.append(Seen(contexts[-1].new_page()))
        return pages[-1].open(address or server.address)

    yield opened
    faults = [fault for seen in pages for fault in seen.faults]
    foreign = [url for seen in pages for url in seen.addresses if not is_ours(url)]
    for context in contexts:
        context.close()
    assert faults == []
    assert foreign == []
