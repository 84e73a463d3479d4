"""The hidden-effect trial: does the diagnosis name what was hidden, all of it, and nothing else?

A simulator of its own hides effects in stages, with another integrator and another formulation than the package's. The
package is given a stage model that is wrong by what it says of itself, recordings with coloured noise, and nothing
else; what it says is scored against the sealed answer::

    python -m studies.hidden_effect_trial                 # all cases of studies/hidden_effect_trial.toml
    python -m studies.hidden_effect_trial --seed 7        # as many cases that nothing was chosen on: fresh rates
    python -m studies.hidden_effect_trial --seed 7 --sample 3   # a third of them, of every stratum
    python -m studies.hidden_effect_trial --imperfect     # benches with structural errors: is the main effect named?
    python -m studies.hidden_effect_trial --rough         # stage models that are off by up to 40 %, and say so
    python -m studies.hidden_effect_trial --ci            # the small part that every change must pass
    python -m studies.hidden_effect_trial --case 20003    # one case, and what was said of it
    python -m studies.hidden_effect_trial --report        # the report of what is done so far

The default seed, 20191, is the training seed: constants of the package were chosen on its cases. Of each case's ten
runs seven are fitted, two choose the model, and one is for testing: errors are stated on it. A trial goes on where it
stopped; what comes of a seed is in ``reports/hidden_effect_trial/seed-N``, ``imperfect-seed-N`` or
``rough-seed-N``.
"""
