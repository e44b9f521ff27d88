"""Routes of a check: between stations, or between places far apart."""

import pytest
from support.costmaps import blank_room

from locplan.advice.routes import plan_routes
from locplan.errors import ConfigError
from locplan.planning import Query


def test_routes_of_one_file_are_refused():
    """One recommended path would replace the other without a word."""
    queries = [Query("Dock/1", (0.5, 0.5), (2.5, 1.5)), Query("dock 1", (0.5, 0.5), (2.5, 2.5))]
    with pytest.raises(ConfigError, match="'Dock/1' and 'dock 1' would be saved as one file"):
        plan_routes(blank_room(), queries, 4, 1)
    assert [*plan_routes(blank_room(), queries[:1], 4, 1)] == ["Dock/1"]
