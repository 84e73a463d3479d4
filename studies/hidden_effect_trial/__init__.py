"""The hidden-effect trial: does the diagnosis name what was hidden, all of it, and nothing else?

A simulator of its own hides effects in stages, with another integrator and another formulation than the package's. The
package is given a stage model that is wrong by what it says of itself, recordings with coloured noise, and nothing
else; what it says is scored against the sealed answer::

    python -m studies.hidden_effect_trial                 # all cases of studies/hidden_effect_trial.toml
    python -m studies.hidden_effect_trial --ci            # the small part that every change must pass
    python -m studies.hidden_effect_trial --case 20003    # one case, and what was said of it
    python -m studies.hidden_effect_trial --report        # the report of what is done so far

A trial goes on where it stopped; each case leaves one file in ``reports/hidden_effect_trial/cases``.
"""
