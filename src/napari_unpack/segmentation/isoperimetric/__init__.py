"""The paper's method: recursive binary splitting by isoperimetric cuts."""
