"""Run by Alembic: migrates the connection that `database.migrate` hands over, in its transaction."""

from alembic import context

from stereomend.jobs.ledger.schema import metadata

context.configure(connection=context.config.attributes["connection"], target_metadata=metadata)
with context.begin_transaction():
    context.run_migrations()
