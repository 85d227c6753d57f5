"""What scripts on several processes assert of all of them together."""


def assert_same_everywhere(comm, *arrays):
    """Arrays have the same bits on all processes."""
    for array in arrays:
        assert len(set(comm.allgather(array.tobytes()))) == 1


def raised_everywhere(comm, task) -> Exception:
    """What a task raises on all processes, which is the same."""
    try:
        task()
    except Exception as error:
        raised = error
    else:
        raised = None
    words = comm.allgather(f"{type(raised).__name__}: {raised}")
    assert raised is not None, words
    assert len(set(words)) == 1, words
    return raised
