"""The prediction approaches, all behind one interface: :class:`crashfuse.approaches.base.Approach`."""
