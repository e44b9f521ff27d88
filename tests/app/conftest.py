"""A server of the explorer and windows of a browser, which tests of the page share."""

from __future__ import annotations

import pytest


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    """The explorer on two corridors."""
    from support.browser import corridors, serve

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("LOCPLAN_CACHE", str(tmp_path_factory.getbasetemp() / "cache"))
        ends = {"start": (3.0, 1.0), "goal": (39.0, 1.0)}
        with serve(*corridors(), folder=tmp_path_factory.mktemp("written"), **ends) as explorer:
            yield explorer


@pytest.fixture
def visit(browser, server):
    """Open the page in a window; at the end it must have no error and no foreign address."""
    from support.browser import Window, is_local

    server.session.apply_changes(())
    contexts, windows = [], []

    def visit_page(address=None, answers=None, about=None, **options):
        context = browser.new_context(**{"viewport": {"width": 1200, "height": 800}} | options)
        window = Window(context.new_page())
        contexts.append(context)
        windows.append(window)
        if answers:
            window.answer(answers)
        if about:
            window.page.route("**/about", lambda route: route.fulfill(json=about(route)))
        return window.open(address or server.address)

    yield visit_page
    faults = [fault for window in windows for fault in window.faults]
    foreign = [url for window in windows for url in window.addresses if not is_local(url)]
    for context in contexts:
        context.close()
    assert faults == []
    assert foreign == []
