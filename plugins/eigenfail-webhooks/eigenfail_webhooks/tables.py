"""The tables of the plug-in, which the service creates when it starts."""

import sqlalchemy as sa

from eigenfail_services.store.migrate import PluginTables
from eigenfail_services.store.schema import Number, Prose

metadata = sa.MetaData()

# A webhook's secret signs what is sent to it: a digest of it could not.
webhooks = sa.Table(
    "plugin_webhooks",
    metadata,
    sa.Column("id", Number, primary_key=True),
    sa.Column("url", sa.Text, nullable=False),
    sa.Column("events", sa.Text, nullable=False),  # JSON
    sa.Column("secret", sa.Text, nullable=False),
    sa.Column("active", sa.Boolean, nullable=False),
    sa.Column("created_ms", sa.BigInteger, nullable=False),
    # Id of the last event of the core's log that was looked at for this webhook.
    sa.Column("read_through", sa.BigInteger, nullable=False),
    sqlite_autoincrement=True,
)

# The outbox: a row for each event and webhook.
deliveries = sa.Table(
    "plugin_webhooks_deliveries",
    metadata,
    sa.Column("id", Number, primary_key=True),
    sa.Column("webhook", Number, sa.ForeignKey(webhooks.c.id), nullable=False),
    sa.Column("event", sa.Text, nullable=False),
    sa.Column("kind", sa.Text, nullable=False),
    sa.Column("payload", sa.Text, nullable=False),  # JSON, as it is sent
    sa.Column("created_ms", sa.BigInteger, nullable=False),
    sa.Column("state", sa.Text, nullable=False),
    sa.Column("attempts", sa.Integer, nullable=False),
    sa.Column("next_ms", sa.BigInteger, nullable=False),
    sa.Column("status", sa.Integer),
    sa.Column("problem", Prose, nullable=False),
    sa.Column("token", sa.Text),
    sa.Column("lease_until_ms", sa.BigInteger, nullable=False),  # by the clock of leases
    sa.Column("lease_ms", sa.BigInteger, nullable=False),
    sa.Index("ix_plugin_webhooks_deliveries_due", "state", "next_ms"),
    sa.Index("ix_plugin_webhooks_deliveries_webhook", "webhook", "id"),
    sqlite_autoincrement=True,
)

tables = PluginTables(metadata)
