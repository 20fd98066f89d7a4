"""A person's review: which decisions are doubtful, what an answer changes, what it teaches."""
