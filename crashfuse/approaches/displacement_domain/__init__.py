"""The paper's displacement domain (Sect. 3.2): the CAE model's bias over displacement, integrated in time."""
