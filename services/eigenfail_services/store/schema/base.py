"""What all tables belong to, and the version of the whole."""

from sqlalchemy import MetaData

VERSION = "0016"
"""The newest migration: what this program was made for."""

VERSION_TABLE = "eigenfail_schema"

metadata = MetaData(
    naming_convention={
        "pk": "pk_%(table_name)s",
        "fk": "fk_%(table_name)s_%(column_0_name)s",
        "ix": "ix_%(table_name)s_%(column_0_N_name)s",
        "uq": "uq_%(table_name)s_%(column_0_N_name)s",
        "ck": "ck_%(table_name)s_%(constraint_name)s",
    }
)
