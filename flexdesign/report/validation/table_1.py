"""Table 1 of a part: FEM and the analytic models, for the report and for a terminal."""

from __future__ import annotations

from flexdesign.report.document import Table
from flexdesign.report.validation import port_section
from flexdesign.report.wording import MODELS, NAMES, format_quantity, name_of
from flexdesign.workflows.validation import Validation


def brief(validation: Validation) -> Table:
    """Return Table 1 for a terminal of 80 columns."""
    return _compact(table(validation)) if validation.comparisons else table(validation)


def table(validation: Validation) -> Table:
    """Return FEM and the analytic models, with relative errors."""
    models = list(dict.fromkeys(model for c in validation.comparisons for model in c.analytic))
    columns = ["quantity", "boundary", "FEM"]
    for model in models:
        columns += [model, "error"]
    rows = []
    if not validation.comparisons:
        return port_section.table_1(validation)
    for comparison in validation.comparisons:
        row = [name_of(comparison.fem), comparison.fem.boundary, format_quantity(comparison.fem)]
        for model in models:
            analytic, error = comparison.analytic.get(model), comparison.error(model)
            row += [analytic.formatted() if analytic else "–", f"{100 * error:+.1f} %" if error is not None else "–"]
        rows.append(row)
    known = "".join(f"; {model}: {MODELS[model]}" for model in models if model in MODELS)
    return Table(columns, rows, f"FEM ± estimated discretisation error; errors relative to FEM{known}")


def text(validation: Validation) -> list[str]:
    """Say which models are compared with FEM, and what is lacking."""
    sources: dict[str, list[str]] = {}
    for comparison in validation.comparisons:
        for model, quantity in comparison.analytic.items():
            sources.setdefault(model, []).append(quantity.source)
    if not sources:
        return ["Nothing is compared with FEM: the part states no formulas, and its linkage is no frame."]
    return [
        "Stiffness depends on what holds the other port, so every row names its boundary. Forces act as uniform "
        "tractions on the port faces, displacements are area averages; the ground face is held.",
        *(f"{model}: {'; '.join(dict.fromkeys(found))}." for model, found in sources.items()),
    ]


def _compact(table: Table) -> Table:
    """Fit Table 1 into 80 columns: symbol and unit alone, and of several models the first and the last."""
    rows = []
    symbols = {"first_frequency": "f_1", "output_frequency": "f of 1/K_out", "drive_frequency": "f of static stroke"}
    short = {NAMES[name]: symbol for name, symbol in symbols.items()}
    for name, boundary, fem, *rest in table.rows:
        value, _, tail = fem.partition(" ± ")
        error, _, unit = tail.partition(" ")
        cells = [cell.split()[0] for cell in (rest if len(rest) <= 4 else [*rest[:2], *rest[-2:]])]
        rows.append([f"{short.get(name, name.split()[-1])} {boundary}", f"{value} ± {error}", unit, *cells])
    columns = table.columns[3:] if len(table.columns) <= 7 else [*table.columns[3:5], *table.columns[-2:]]
    heads = ["err %" if head == "error" else head for head in columns]
    return Table(["", "FEM", "", *heads], rows, table.caption)
