"""The confidence oracle of Li et al. 2012, section 3: features, mixture, log-likelihood."""
