"""SQLAlchemy, which stores maps: a library of the extra ``maps``, without which everything but maps works."""

from trackfg.errors import TrackfgError

try:
    import sqlalchemy as sa
except ImportError as error:
    raise TrackfgError("sqlalchemy is not installed. Hint: pip install 'trackfg[maps]'") from error

__all__ = ["sa"]
