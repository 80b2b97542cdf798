# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Errors that give the new names of renamed attributes."""

from collections.abc import Callable, Mapping
from typing import Any, TypeVar

Class = TypeVar('Class', bound=type)


def renamed_attributes(**names: str) -> Callable[[Class], Class]:
    """
    Return a decorator of classes whose attributes have new names.

    Reading an attribute by a former name raises AttributeError with the new name. `names` maps
    former names to new ones. Type checkers do not see the decorated `__getattr__`, so they still
    report attributes that the class lacks.
    """
    def decorate(cls: Class) -> Class:
        def find_missing(self: Any, name: str) -> Any:
            if name in names:
                raise AttributeError(renamed_text(cls.__name__, name, names))
            return object.__getattribute__(self, name)

        cls.__getattr__ = find_missing  # type: ignore[attr-defined]
        return cls

    return decorate


def renamed_text(owner: str, name: str, names: Mapping[str, str]) -> str:
    """Return the error for a former name of an attribute of `owner`."""
    return f'{owner}.{name} has been renamed: use {owner}.{names[name]}'
