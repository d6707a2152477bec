"""tmp"""


class Cause: ...


class Diagnosis: ...


class Held: ...
