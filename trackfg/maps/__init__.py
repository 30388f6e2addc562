"""Feature maps of a line, and their storage in a GeoPackage or a PostgreSQL database."""

from typing import TYPE_CHECKING, Any

from trackfg.maps.feature_map import FeatureMap, MapConventions, RunInformation

if TYPE_CHECKING:
    from trackfg.maps.store import MapConflictError, read_map, read_versions, write_map

__all__ = [
    "FeatureMap",
    "MapConflictError",
    "MapConventions",
    "RunInformation",
    "read_map",
    "read_versions",
    "write_map",
]


def __getattr__(name: str) -> Any:
    """Import what stores maps when it is first used, since only that needs SQLAlchemy, an extra."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from trackfg.maps import store

    return getattr(store, name)
