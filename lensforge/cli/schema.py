"""``schema``: the JSON schema of a spec, for editors, or its reference page."""

import json

import click

from lensforge.spec.spec_reference import reference_page, spec_schema


@click.command()
@click.option("--page", is_flag=True, help="Print the reference of all fields as Markdown instead (docs/spec.md).")
def schema(page: bool) -> None:
    """Print the JSON schema of a spec, by which an editor completes and checks it."""
    click.echo(reference_page() if page else json.dumps(spec_schema(), indent=1, ensure_ascii=False), nl=not page)
