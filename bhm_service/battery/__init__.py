"""The one pack model that the estimator, the predictor, the identification and the search for physics use."""
