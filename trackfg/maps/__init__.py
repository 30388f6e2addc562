"""Feature maps: what repeated runs say together about a line, and how it is stored.

=====================  ===============================================================================================
module                 content
=====================  ===============================================================================================
``feature_map``        the map in memory
``store``              :func:`read_map`, :func:`write_map`, :func:`read_versions`
``location``           where a map is: a GeoPackage (a file) or a PostgreSQL database
``schema``, ``rows``   the tables, the same in both, and the way of data frames and matrices in and out
``geopackage``         what makes an SQLite file a GeoPackage
``postgres``           what PostgreSQL needs besides, with PostGIS or without
``layers``             the landmarks and the reference line as a GIS draws them
``geometry_blob``      points and lines as bytes
``geodetic``           from the map's local frame to latitude and longitude
=====================  ===============================================================================================
"""

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
