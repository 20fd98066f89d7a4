from .run import BatchReport, batch

__all__ = ["BatchReport", "batch"]
