"""`ispom experiment`: sources, methods, settings and seeds, a run each; tables, figures and a page of what came out."""
