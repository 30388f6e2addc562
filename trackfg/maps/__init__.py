"""Feature maps of a line, and their storage in a GeoPackage or a PostgreSQL database."""

from trackfg.maps.feature_map import FeatureMap, MapConventions, RunInformation
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
