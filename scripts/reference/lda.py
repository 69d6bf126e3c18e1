"""Golden numbers for crates/classify/src/lda.rs: scikit-learn's pipeline on made-up rows. Seed 5; scikit-learn as printed in the file.

    python scripts/reference/lda.py > crates/classify/tests/golden/lda.json
"""
import json

import numpy as np
import sklearn
from sklearn.decomposition import PCA
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

rng = np.random.default_rng(5)
cases = []
# classes, rows, features, components; the last has fewer rows in a class than components
for classes, n, features, components in [(2, 30, 5, 5), (3, 40, 8, 4), (4, 26, 12, 9)]:
    mixing = rng.normal(size=(features, features))
    labels = np.sort(rng.integers(0, classes, n))
    centres = rng.normal(size=(classes, features)) * 1.5
    rows = np.round((rng.normal(size=(n, features)) + centres[labels]) @ mixing, 4)
    asked = np.round((rng.normal(size=(5, features)) + centres[rng.integers(0, classes, 5)]) @ mixing, 4)
    lda = LinearDiscriminantAnalysis(solver="lsqr", shrinkage="auto")
    model = make_pipeline(StandardScaler(), PCA(components, svd_solver="full"), lda).fit(rows, labels)
    cases.append({
        "components": components,
        "rows": rows.tolist(),
        "labels": labels.tolist(),
        "asked": asked.tolist(),
        "log_p": model.predict_log_proba(asked).tolist(),
    })
print(json.dumps({"made_by": f"scikit-learn {sklearn.__version__}, numpy {np.__version__}, seed 5", "cases": cases}))
