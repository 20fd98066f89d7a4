"""The state of an unpacking and the verbs that change it."""
