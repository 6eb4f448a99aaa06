"""The papers' experiments: what is run, what comes out, and the printed results to set beside it.

One module per paper, one literal registry (``protocols.EXPERIMENTS``). A paper's module makes jobs (one method on one
take with one loss and one seed), tables and figures; ``store`` keeps what a job found, ``plots`` draws. Nothing here
prints.
"""
