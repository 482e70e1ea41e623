"""The ways to predict a pulse, behind one contract: :class:`crashfuse.approaches.base.Approach`."""
