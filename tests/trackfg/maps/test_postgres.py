"""The layers in PostgreSQL, with PostGIS and without."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from trackfg.errors import BadInputError
from trackfg.maps import FeatureMap, read_map, write_map

MakeMap = Callable[..., FeatureMap]
ORIGIN = (35.2, 137.1, 40.0)


@pytest.fixture
def spatial(server: Any) -> Any:
    if not server.postgis:
        pytest.skip("PostGIS not installed")
    return server


def layer_types(server: Any, database: str, schema: str) -> list[str]:
    query = "SELECT format_type(atttypid, atttypmod) FROM pg_attribute WHERE attname = 'geom' AND attrelid IN "
    relations = f"('{schema}.landmarks'::regclass, '{schema}.reference_line'::regclass) ORDER BY attrelid"
    return list(server.sql(database, query + relations).splitlines())


def test_a_column_of_another_type_is_refused(make_map: MakeMap, server: Any) -> None:
    url = server.url("plain", "retyped")
    write_map(make_map(), url, parent=None)
    server.sql("plain", "ALTER TABLE retyped.map_grid ALTER COLUMN chainage_m_sd TYPE text USING chainage_m_sd::text")
    with pytest.raises(BadInputError, match=r"schema=retyped: Unknown PG numeric type: 25.*; expected a feature map"):
        read_map(url)


def test_a_renamed_column_is_not_written_to(make_map: MakeMap, server: Any) -> None:
    url = server.url("plain", "renamed")
    write_map(make_map(), url, parent=None)
    server.sql("plain", "ALTER TABLE renamed.map_runs RENAME COLUMN version TO other")
    with pytest.raises(BadInputError, match=r'column "version" of relation "map_runs" does not exist'):
        write_map(make_map(), url, parent=1)


def test_postgis_knows_the_layers(make_map: MakeMap, spatial: Any) -> None:
    made = make_map(origin=ORIGIN, cells=10_001)
    write_map(made, spatial.url("spatial", "known"), parent=None)
    query = "SELECT f_table_name, type, coord_dimension, srid FROM geometry_columns WHERE f_table_schema = 'known'"
    assert spatial.sql("spatial", f"{query} ORDER BY 1").splitlines() == [
        "landmarks|POINT|3|4326",
        "reference_line|LINESTRING|4|4326",
    ]
    assert spatial.sql("spatial", "SELECT bool_and(ST_IsValid(geom)), count(*) FROM known.reference_line") == "t|3"
    length = float(spatial.sql("spatial", "SELECT sum(ST_Length(geom::geography)) FROM known.reference_line"))
    enu = made.line[["east_m", "north_m"]].to_numpy()
    assert length == pytest.approx(np.sum(np.hypot(*np.diff(enu, axis=0).T)), rel=3e-5)
    there = "SELECT ST_GeometryN(ST_Force3DZ(ST_LocateAlong(geom, 0)), 1) AS p FROM known.reference_line LIMIT 1"
    place = spatial.sql("spatial", f"SELECT ST_X(p), ST_Y(p), ST_Z(p) FROM ({there}) AS found")
    np.testing.assert_allclose([float(x) for x in place.split("|")], [137.1, 35.2, 40.5], atol=1e-9)


def test_a_map_becomes_georeferenced(make_map: MakeMap, spatial: Any) -> None:
    """The columns change their system and keep the rights that were granted on the table."""
    url = spatial.url("spatial", "changing")
    write_map(make_map(), url, parent=None)
    assert layer_types(spatial, "spatial", "changing") == ["geometry(PointZ)", "geometry(LineStringZM)"]
    spatial.sql("spatial", "GRANT SELECT ON changing.landmarks TO PUBLIC")
    write_map(make_map(origin=ORIGIN), url, parent=1)
    assert layer_types(spatial, "spatial", "changing") == ["geometry(PointZ,4326)", "geometry(LineStringZM,4326)"]
    systems = "SELECT ST_SRID(geom), version, count(*) FROM changing.landmarks GROUP BY 1, 2 ORDER BY 1"
    assert spatial.sql("spatial", systems).splitlines() == ["4326|2|12", "|2|1"]
    assert spatial.sql("spatial", "SELECT has_table_privilege('public', 'changing.landmarks', 'SELECT')") == "t"
    # a view of the team's own holds the column fast, but only a change of system would touch it
    spatial.sql("spatial", "CREATE VIEW changing.mine AS SELECT landmark_id, geom FROM changing.landmarks")
    write_map(make_map(seed=1, origin=ORIGIN), url, parent=2)
    assert spatial.sql("spatial", "SELECT count(*) FROM changing.mine") == "13"


def test_postgis_in_a_schema_of_its_own(make_map: MakeMap, spatial: Any) -> None:
    """Not on the search path of whoever writes."""
    spatial.sql("postgres", "CREATE DATABASE apart")
    spatial.sql("apart", "CREATE SCHEMA gis; CREATE EXTENSION postgis SCHEMA gis")
    write_map(make_map(origin=ORIGIN), spatial.url("apart", "line"), parent=None)
    assert spatial.sql("apart", "SELECT DISTINCT gis.ST_SRID(geom) FROM line.reference_line") == "4326"


def test_without_postgis_the_layers_hold_wkb(make_map: MakeMap, server: Any) -> None:
    for origin, parent in ((None, None), (ORIGIN, 1)):
        write_map(make_map(origin=origin), server.url("plain", "bytes"), parent=parent)
    assert layer_types(server, "plain", "bytes") == ["bytea", "bytea"]
    query = "SELECT DISTINCT encode(substr(geom, 1, 5), 'hex') FROM bytes.landmarks WHERE geom IS NOT NULL"
    heads = server.sql("plain", query)
    assert heads == "01e9030000"  # little-endian, type 1001


def test_postgis_that_comes_later(make_map: MakeMap, spatial: Any) -> None:
    """Layers keep the kind of column that they were created with; their bytes are what PostGIS takes."""
    spatial.sql("postgres", "CREATE DATABASE later")
    url = spatial.url("later", "line")
    write_map(make_map(), url, parent=None)
    spatial.sql("later", "CREATE EXTENSION postgis")
    write_map(make_map(origin=ORIGIN), url, parent=1)
    assert layer_types(spatial, "later", "line") == ["bytea", "bytea"]
    text = spatial.sql("later", "SELECT DISTINCT ST_GeometryType(ST_GeomFromWKB(geom, 4326)) FROM line.reference_line")
    assert text == "ST_LineString"


def test_unknown_numbers_are_null(make_map: MakeMap, server: Any) -> None:
    """Not NaN, which PostgreSQL holds greater than every number."""
    write_map(make_map(), server.url("plain", "nulls"), parent=None)
    assert server.sql("plain", "SELECT count(*) FROM nulls.map_grid WHERE cant_mm IS NULL") == "4"
    assert server.sql("plain", "SELECT count(*) FROM nulls.map_grid WHERE cant_mm = 'NaN'") == "0"


def test_a_table_of_anothers_is_not_taken_for_a_layer(make_map: MakeMap, server: Any) -> None:
    server.sql("plain", "CREATE SCHEMA theirs; CREATE TABLE theirs.landmarks AS SELECT 7 AS fid, ''::bytea AS geom")
    with pytest.raises(BadInputError, match="holds a table landmarks but no map"):
        write_map(make_map(cells=41), server.url("plain", "theirs"), parent=None)
    assert server.sql("plain", "SELECT fid FROM theirs.landmarks") == "7"


def test_a_writer_who_may_not_make_schemas(make_map: MakeMap, server: Any) -> None:
    """In the schema that the owner of the database made for him."""
    server.sql("plain", "CREATE ROLE writer LOGIN; CREATE SCHEMA given AUTHORIZATION writer")
    url = server.url("plain", "given").replace("trackfg@", "writer@")
    assert write_map(make_map(cells=41), url, parent=None).version == 1
    with pytest.raises(BadInputError, match="permission denied"):
        write_map(make_map(cells=41), url.replace("schema=given", "schema=own"), parent=None)


def test_a_reader_without_rights_to_write(make_map: MakeMap, server: Any) -> None:
    write_map(make_map(), server.url("plain", "rights"), parent=None)
    server.sql("plain", "CREATE ROLE reader LOGIN; GRANT USAGE ON SCHEMA rights TO reader")
    server.sql("plain", "GRANT SELECT ON ALL TABLES IN SCHEMA rights TO reader")
    url = server.url("plain", "rights").replace("trackfg@", "reader@")
    assert read_map(url).version == 1
